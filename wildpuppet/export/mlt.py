"""MLT (Kdenlive, Shotcut, melt): NAME.mlt, a track per part with the part's drawn edge as a rotoscoping spline.

Each track is a flat colour under ``rotoscoping`` filters, one per outline, so that the file plays as it is; put your
clip in the colour's place, or copy the filter onto it in the editor. Splines are in shares of the picture's width and
height, their frames counted from the track's start. A track is empty where the character is lost, and a part that
changes its place in the order has further tracks.
"""

import json
from collections.abc import Iterator, Sequence
from itertools import groupby
from math import gcd
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from wildpuppet.export.animation import Animation
from wildpuppet.export.keys import Segment, keys
from wildpuppet.export.manifest import Manifest, rounding_error
from wildpuppet.export.naming import file_names, printable
from wildpuppet.export.options import Options
from wildpuppet.export.outlines import Outline, outlines
from wildpuppet.export.palette import colour_of
from wildpuppet.export.stacking import Sheet, sheets
from wildpuppet.geometry.affine import apply
from wildpuppet.machine import Progress

DECIMALS = 6
"""Of shares of the picture."""
Element = ElementTree.Element


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write NAME.mlt."""
    last, stack = len(animation) - 1, sheets(animation.order)
    root = ElementTree.Element("mlt", {"LC_NUMERIC": "C", "version": "7.0.0", "producer": "main", "root": ""})
    root.set("title", printable(animation.name))
    root.append(_profile(animation))
    root.append(_colour("under", "#00000000", last))
    for layer, name in enumerate(animation.puppet.names):
        red, green, blue = colour_of(layer)
        producer = _colour(f"part{layer}", f"#ff{red:02x}{green:02x}{blue:02x}", last)
        _property(producer, "kdenlive:clipname", printable(name))
        producer.extend(_filters(animation, outlines(animation.puppet, layer)))
        root.append(producer)
        progress(layer + 1, animation.puppet.num_layers)
    root.extend(_playlist(animation, number, sheet) for number, sheet in enumerate(stack))
    root.append(_tractor(len(stack), last))
    path = folder / f"{file_names([animation.name])[0]}.mlt"
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    left_out = ["meshes, textures, joints: these are outlines", "holes in parts and their small islands"]
    if animation.timing.is_variable:
        left_out.append("the clip's uneven times: MLT counts frames")
    size = np.array(animation.size, np.float64)
    error = rounding_error(animation, lambda places: np.round(places / size, DECIMALS) * size)
    axes = "x right, y down, shares of W and H"
    return Manifest("top left corner of the picture", axes, 0, 1.0, tuple(left_out), error)


def _profile(animation: Animation) -> Element:
    (width, height), rate = animation.size, animation.timing.rate
    common = gcd(width, height)
    said = {
        "description": "wildpuppet", "width": width, "height": height, "progressive": 1, "sample_aspect_num": 1,
        "sample_aspect_den": 1, "display_aspect_num": width // common, "display_aspect_den": height // common,
        "frame_rate_num": rate.numerator, "frame_rate_den": rate.denominator, "colorspace": 709,
    }  # fmt: skip
    return ElementTree.Element("profile", {name: str(value) for name, value in said.items()})


def _property(parent: Element, name: str, value: object) -> None:
    ElementTree.SubElement(parent, "property", {"name": name}).text = str(value)


def _colour(name: str, colour: str, last: int) -> Element:
    producer = ElementTree.Element("producer", {"id": name, "in": "0", "out": str(last)})
    for key, value in (("length", last + 1), ("eof", "pause"), ("resource", colour), ("mlt_service", "color")):
        _property(producer, key, value)
    _property(producer, "mlt_image_format", "rgba")
    return producer


def _filters(animation: Animation, edges: Sequence[Outline]) -> Iterator[Element]:
    for number, outline in enumerate(edges):
        made = ElementTree.Element("filter", {"id": f"outline{outline.layer}_{number}"})
        _property(made, "mlt_service", "rotoscoping")
        _property(made, "kdenlive_id", "rotoscoping")
        _property(made, "mode", "alpha")
        _property(made, "alpha_operation", "max" if number else "clear")
        _property(made, "spline", spline(animation, outline))
        yield made


def spline(animation: Animation, outline: Outline) -> str:
    """Write an outline's keys: what is held has a key at its start and its end, for MLT glides between keys."""
    seen = [
        (pose, window.tobytes())
        for pose, window in zip(animation.pose.tolist(), animation.video_from_crop, strict=True)
    ]
    frames: dict[str, list[list[list[float]]]] = {}
    for key in keys(seen, Segment("", 0, len(animation))):
        points = _shares(animation, outline, key.at)
        for t in sorted({key.at, key.at + key.duration - 1}):
            frames[str(t)] = points
    return json.dumps(frames, separators=(",", ":"))


def _shares(animation: Animation, outline: Outline, t: int) -> list[list[list[float]]]:
    """Give each point between two handles that lie on it: the pieces are straight."""
    places = apply(animation.video_from_crop[t], outline.at(animation.vertices_crop[t]))
    return [[point] * 3 for point in np.round(places / np.array(animation.size), DECIMALS).tolist()]


def _playlist(animation: Animation, number: int, sheet: Sheet) -> Element:
    """Lay a part's pieces on a track; between them, and where the character is lost, the track is empty."""
    playlist = ElementTree.Element("playlist", {"id": f"track{number}"})
    for is_shown, run in groupby(enumerate(sheet.shown(animation.is_visible).tolist()), key=lambda pair: pair[1]):
        frames = [t for t, _ in run]
        if is_shown:
            place = {"producer": f"part{sheet.layer}", "in": str(frames[0]), "out": str(frames[-1])}
            ElementTree.SubElement(playlist, "entry", place)
        else:
            ElementTree.SubElement(playlist, "blank", {"length": str(len(frames))})
    return playlist


def _tractor(num_tracks: int, last: int) -> Element:
    tractor = ElementTree.Element("tractor", {"id": "main", "in": "0", "out": str(last)})
    for name in ("under", *(f"track{number}" for number in range(num_tracks))):
        ElementTree.SubElement(tractor, "track", {"producer": name})
    for track in range(1, num_tracks + 1):
        over = ElementTree.SubElement(tractor, "transition", {"in": "0", "out": str(last)})
        for key, value in (("a_track", 0), ("b_track", track), ("mlt_service", "qtblend"), ("always_active", 1)):
            _property(over, key, value)
    return tractor
