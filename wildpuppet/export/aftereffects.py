"""After Effects: NAME.jsx, a script that builds the composition, and the parts' picture sequences beside it.

File > Scripts > Run Script File. It makes a composition of the video's size, rate and length; imports every part as a
sequence with straight alpha; lays them in order, with further layers where the order changes; gives each layer its
part's outlines as animated masks (mode None: they cut nothing until you say so); and makes a null per hinge. Keys are
held where a drawing is held. The language is ExtendScript, which is ECMAScript 3.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wildpuppet.export.animation import Animation
from wildpuppet.export.json_stream import DECIMALS, write_json
from wildpuppet.export.keys import Key, Segment, joints, keys
from wildpuppet.export.manifest import Manifest, rounding_error
from wildpuppet.export.naming import file_names
from wildpuppet.export.options import Options
from wildpuppet.export.stacking import sheets
from wildpuppet.geometry.affine import apply
from wildpuppet.machine import Progress

if TYPE_CHECKING:
    from wildpuppet.export.outlines import Outline

SCRIPT = """
    function at(frame) {
        return TIMES.length ? TIMES[frame] : frame * comp.frameDuration;
    }
    function setKeys(property, keys, values) {
        var times = [], k;
        for (k = 0; k < keys.length; k++) {
            times.push(at(keys[k][0]));
        }
        property.setValuesAtTimes(times, values);
        for (k = 0; k < keys.length; k++) {
            property.setInterpolationTypeAtKey(k + 1,
                keys[k][1] ? KeyframeInterpolationType.HOLD : KeyframeInterpolationType.LINEAR);
        }
    }
    function shapeOf(numbers) {
        var shape = new Shape(), points = [], flat = [], i;
        for (i = 0; i < numbers.length; i += 2) {
            points.push([numbers[i], numbers[i + 1]]);
            flat.push([0, 0]);
        }
        shape.vertices = points;
        shape.inTangents = flat;
        shape.outTangents = flat;
        shape.closed = true;
        return shape;
    }
    function footageOf(part) {
        var file = new File(here.fsName + "/" + part.pictures), options, item;
        if (!file.exists) {
            throw new Error("wildpuppet: " + file.fsName + " is missing; keep the script beside its layers folder");
        }
        options = new ImportOptions(file);
        options.sequence = true;
        item = app.project.importFile(options);
        item.name = part.name;
        item.mainSource.conformFrameRate = RATE;
        item.mainSource.alphaMode = AlphaMode.STRAIGHT;
        return item;
    }
    function addMask(layer, name, outline) {
        var mask = layer.property("ADBE Mask Parade").addProperty("ADBE Mask Atom"), shapes = [], k;
        for (k = 0; k < outline.points.length; k++) {
            shapes.push(shapeOf(outline.points[k]));
        }
        mask.name = name;
        mask.maskMode = MaskMode.NONE;
        setKeys(mask.property("ADBE Mask Shape"), outline.keys, shapes);
    }

    function showIn(layer, spans) {
        var end = spans[spans.length - 1][1], keys = [], values = [], k;
        layer.inPoint = at(spans[0][0]);
        layer.outPoint = end < FRAMES ? at(end) : comp.duration;
        if (spans.length > 1) {
            for (k = 0; k < spans.length; k++) {
                keys.push([spans[k][0], 1]);
                values.push(100);
                if (spans[k][1] < FRAMES) {
                    keys.push([spans[k][1], 1]);
                    values.push(0);
                }
            }
            setKeys(layer.property("ADBE Transform Group").property("ADBE Opacity"), keys, values);
        }
    }

    var here = new File($.fileName).parent;
    var footage = [], i, j, comp, part, layer, helper;
    app.beginUndoGroup("wildpuppet: " + NAME);
    try {
        comp = app.project.items.addComp(NAME, WIDTH, HEIGHT, 1, DURATION, RATE);
        for (i = 0; i < PARTS.length; i++) {
            footage.push(footageOf(PARTS[i]));
        }
        for (i = 0; i < SHEETS.length; i++) {
            part = PARTS[SHEETS[i].part];
            layer = comp.layers.add(footage[SHEETS[i].part]);
            layer.name = part.name;
            showIn(layer, SHEETS[i].spans);
            for (j = 0; j < part.outlines.length; j++) {
                addMask(layer, part.name + " outline " + (j + 1), part.outlines[j]);
            }
        }
        for (i = 0; i < JOINTS.length; i++) {
            helper = comp.layers.addNull(comp.duration);
            helper.name = JOINTS[i].name;
            setKeys(helper.property("ADBE Transform Group").property("ADBE Position"),
                JOINTS[i].keys, JOINTS[i].points);
        }
        if (comp.markerProperty) {
            for (i = 0; i < SHOTS.length; i++) {
                comp.markerProperty.setValueAtTime(at(SHOTS[i]), new MarkerValue("shot " + (i + 1)));
            }
        }
        comp.openInViewer();
    } finally {
        app.endUndoGroup();
    }
"""


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write NAME.jsx and layers/PART/PART.NNNNN.png."""
    from wildpuppet.export.draw import Painter
    from wildpuppet.export.png import layer_stems, numbered, write_sequence

    painter, first = Painter(animation), options.first_of(int(animation.frames[0]))
    stems = layer_stems(animation, folder)
    for layer, stem in stems:
        for t in write_sequence(painter.pictures(layer), stem, first):
            progress(layer * len(animation) + t + 1, len(stems) * len(animation))
    pictures = [numbered(stem, first).relative_to(folder).as_posix() for _, stem in stems]
    with (folder / f"{file_names([animation.name])[0]}.jsx").open("w", encoding="ascii") as file:
        file.write("// File > Scripts > Run Script File. Made by wildpuppet.\n(function () {\n")
        for name, value in _data(animation, pictures).items():
            file.write(f"    var {name} = ")
            write_json(file, value, is_ascii=True)
            file.write(";\n")
        file.write(SCRIPT + "}());\n")
    left_out = ["meshes: the parts are pictures under animated outlines, which may be given puppet pins by hand"]
    if animation.timing.is_variable:
        left_out.append("uneven times of the pictures: a sequence has one rate; masks and nulls keep the clip's times")
    error = rounding_error(animation, lambda places: np.round(places, DECIMALS))
    return Manifest("top left corner of the picture", "x right, y down, pixels", first, 1.0, tuple(left_out), error)


def _data(animation: Animation, pictures: Sequence[str]) -> dict[str, Any]:
    timing, (width, height) = animation.timing, animation.size
    times = [round(float(frame.seconds), 9) for frame in animation] if timing.is_variable else []
    return {
        "NAME": animation.name, "WIDTH": width, "HEIGHT": height, "RATE": float(timing.rate),
        "FRAMES": len(animation), "DURATION": round(float(timing.end_seconds()), 9), "TIMES": times,
        "PARTS": _parts(animation, pictures),
        "SHEETS": [{"part": sheet.layer, "spans": sheet.spans} for sheet in sheets(animation.order)],
        "JOINTS": _nulls(animation),
        "SHOTS": animation.shot_starts,
    }  # fmt: skip


def _parts(animation: Animation, pictures: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Give every part's name, pictures and masks."""
    from wildpuppet.export.outlines import outlines

    every = _keys(animation)
    for layer, (name, path) in enumerate(zip(animation.puppet.names, pictures, strict=True)):
        masks = (_mask(animation, outline, every) for outline in outlines(animation.puppet, layer))
        yield {"name": name, "pictures": path, "outlines": masks}


def _mask(animation: Animation, outline: "Outline", every: Sequence[Key]) -> dict[str, Any]:
    places = (apply(animation.video_from_crop[key.at], outline.at(animation.vertices_crop[key.at])) for key in every)
    return {"keys": _steps(every), "points": places}


def _keys(animation: Animation) -> list[Key]:
    """Key what is seen in the video: a new key where the drawing or its window moves."""
    seen = [
        (pose, window.tobytes())
        for pose, window in zip(animation.pose.tolist(), animation.video_from_crop, strict=True)
    ]
    return list(keys(seen, Segment("", 0, len(animation)), animation.shot_starts))


def _steps(every: Sequence[Key]) -> list[list[int]]:
    return [[key.at, 0 if key.is_gliding else 1] for key in every]


def _nulls(animation: Animation) -> list[dict[str, Any]]:
    every = _keys(animation)
    maps = animation.video_from_crop
    return [
        {
            "name": joint.name,
            "keys": _steps(every),
            "points": [np.round(apply(maps[key.at], joint.crop[key.at][None])[0], 4).tolist() for key in every],
        }
        for joint in joints(animation)
    ]
