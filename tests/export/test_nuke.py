"""The Nuke script, evaluated by Tcl itself with Nuke's commands imitated: a stack of nodes with knobs.

Nuke cannot be run here.
"""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from tests.correspond import scene
from tests.export.moving import FIRST, LOST, NUM_FRAMES, moving
from wildpuppet.export import nuke
from wildpuppet.export.options import Options
from wildpuppet.geometry.affine import apply
from wildpuppet.machine import silent

tkinter = pytest.importorskip("tkinter")

PIXELS = 1e-4
NODES = ("Root", "Tracker4", "Constant", "Read", "Premult", "CornerPin2D", "Merge2", "STMap", "Copy")
STUB = """
proc version {args} {}
proc stack {index} { return [lindex $::nodes end-$index] }
proc push {name} { lappend ::nodes $name }
set ::nodes {}
set ::made {}
proc node {kind knobs} {
    set found [dict create kind $kind]
    foreach {name value} $knobs { dict set found $name $value }
    set count [expr {[dict exists $found inputs] ? [dict get $found inputs] : 1}]
    set wires {}
    for {set i 0} {$i < $count} {incr i} {
        lappend wires [lindex $::nodes end]
        set ::nodes [lrange $::nodes 0 end-1]
    }
    dict set found wires $wires
    if {[dict exists $found name]} { lappend ::nodes [dict get $found name] }
    lappend ::made $found
}
"""


class Script:
    """What a script made: nodes by name, with their knobs as text and the nodes they read, input 0 first."""

    def __init__(self, path):
        self.tcl = tkinter.Tcl()
        self.tcl.eval(STUB + "".join(f"proc {kind} {{knobs}} {{ node {kind} $knobs }}\n" for kind in NODES))
        self.tcl.eval(path.read_text(encoding="ascii"))
        made = [self.pairs(node) for node in self.list(self.tcl.eval("set ::made"))]
        self.root = made[0]
        self.nodes = {node["name"]: node for node in made[1:]}

    def list(self, text):
        return [str(item) for item in self.tcl.splitlist(text)]

    def pairs(self, text):
        items = self.list(text)
        return dict(zip(items[::2], items[1::2], strict=True))

    def curve(self, text):
        words = self.list(text)
        assert words[0] == "curve"
        words = words[2:] if words[1] == "K" else words[1:]
        return {int(at.removeprefix("x")): float(value) for at, value in zip(words[::2], words[1::2], strict=True)}


@pytest.fixture(scope="module")
def world():
    return moving()


@pytest.fixture(scope="module")
def written(tmp_path_factory, world):
    folder = tmp_path_factory.mktemp("nuke")
    return folder, nuke.write(world.animation, folder, Options(first_frame=1001), silent)


@pytest.fixture(scope="module")
def script(written):
    return Script(written[0] / "hero_run.nk")


def test_tracks_are_the_hinges(world, script):
    assert (script.root["first_frame"], script.root["last_frame"]) == ("1001", str(1000 + NUM_FRAMES))
    head, columns, rows = script.list(script.nodes["Hinges"]["tracks"])
    assert head.split() == ["1", "31", "1"]
    columns = [script.list(column) for column in script.list(columns)]
    assert len(columns) == 31
    assert [column[3] for column in columns[:4]] == ["enable", "name", "track_x", "track_y"]
    (row,) = script.list(rows)
    row = script.list(row)
    assert len(row) == 31
    assert row[1] == "body_to_arm"
    assert script.curve(row[0]) == {1001: 1.0, 1001 + LOST: 0.0, 1002 + LOST: 1.0}
    x, y = script.curve(row[2]), script.curve(row[3])
    for t in set(range(NUM_FRAMES)) - {LOST}:
        corners = world.vertices(t)[world.puppet.joint_vertices[0]]
        middle = np.einsum("kcd,kc->kd", corners, world.puppet.joint_weights[0]).mean(0)
        assert np.abs(np.array([x[1001 + t], 120 - y[1001 + t]]) - middle).max() < PIXELS


def test_corner_pins_carry_the_pictures_of_the_parts(world, written, script):
    folder, manifest = written
    assert manifest.error.largest < PIXELS  # this puppet's parts move as wholes
    for layer, (name, ink) in enumerate(zip(world.puppet.names, (scene.BODY, scene.ARM), strict=True)):
        left, top, width, height = ink
        assert Image.open(folder / "parts" / f"{name}.png").size == (width, height)
        pin = script.nodes[f"{name}_pin"]
        rest = [(left, top + height), (left + width, top + height), (left + width, top), (left, top)]
        assert [script.list(pin[f"from{k}"]) for k in (1, 3)] == [["0", "0"], [str(width), str(height)]]
        for k, corner in enumerate(rest, 1):
            x, y = (script.curve(axis) for axis in script.list(pin[f"to{k}"]))
            for t in range(NUM_FRAMES):
                goal = apply(world.maps[t, layer], np.array([corner], float))[0]
                if t != LOST:
                    assert np.abs(np.array([x[1001 + t], 120 - y[1001 + t]]) - goal).max() < PIXELS


def test_nodes_are_wired_as_meant(script):
    wires = {name: script.list(node["wires"]) for name, node in script.nodes.items()}
    assert wires["arm_pin"] == ["arm_premult"]
    assert wires["arm_premult"] == ["arm_picture"]
    assert wires["Lookup"] == ["Atlas", "Map"]
    assert wires["Coverage"] == ["Lookup", "Map"]
    assert wires["Drawn"] == ["Coverage"]
    assert script.nodes["Map"]["file"].endswith("/../exr/st/st.%05d.exr")
    assert script.nodes["Map"]["file"].startswith("[file dirname")  # kept for Nuke to evaluate


def test_pins_are_merged_in_the_order_of_each_frame(world, script):
    chain, name = [], next(reversed([name for name in script.nodes if "_over_" in name]))
    while name != "Empty":
        below, above = script.list(script.nodes[name]["wires"])  # B, A
        (disable,) = script.list(script.nodes[name]["disable"])
        chain.append((above.removesuffix("_pin"), script.curve(disable)))
        name = below
    for t, order in enumerate(world.animation.order):
        at = 1001 + t
        shown = [part for part, off in chain[::-1] if off[max(key for key in off if key <= at)] == 0.0]
        assert shown == ([] if t == LOST else [world.puppet.names[layer] for layer in order])


def test_names_that_tcl_would_run_stay_names(tmp_path, world):
    evil = replace(world.puppet, names=("[exit]{", 'a "b" $c\\'))
    nuke.write(replace(world.animation, puppet=evil), tmp_path, Options(), silent)
    found = Script(tmp_path / "hero_run.nk")
    assert {"exit_pin", "a_b_c_pin"} <= set(found.nodes)
    assert found.root["first_frame"] == str(FIRST)
