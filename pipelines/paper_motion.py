"""Tables 3 and 4 of the paper's tables: what the fitted puppets are good for, on our own runs.

Table 3 leaves drawings out and predicts them from their neighbours; Table 4 drags training drawings to test
drawings. What is measured is kept in OUT/sets/SET as long as the set's files, the settings and the stages stay.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import msgspec

from wildpuppet.errors import WildPuppetError
from wildpuppet.store import digest_of, read_json

from .paper_tables import stages_of
from .paper_work import Picture, SetWork, ours_settings

if TYPE_CHECKING:
    from wildpuppet.tables.table import Score

VERSION = 2
SCHEMA = "wildpuppet.application-scores/1"
ROWS = 4
"""Rows of a figure."""
DRAGGED = 12
"""Test drawings that are dragged to, evenly spread."""


def scores_of(work: SetWork, name: str) -> "list[Score] | str":
    """Give the scores of ``inbetween`` or ``drag``, kept or new; a reason in words where there are none."""
    from wildpuppet import atomic
    from wildpuppet.tables.table import Score

    path = work.out / "sets" / work.case.name / f"{name}.json"
    identity = digest_of([VERSION, work.content, stages_of(ours_settings)(work)])
    tree = read_json(path) if path.is_file() else {}
    if (tree.get("schema"), tree.get("identity")) != (SCHEMA, identity):
        work.reporter.begin(name)
        try:
            tree = {"schema": SCHEMA, "identity": identity, **APPLICATIONS[name](work)}
        except WildPuppetError as error:
            return str(error)
        work.reporter.end(name, False)
        atomic.write_text(path, msgspec.json.format(msgspec.json.encode(tree), indent=1).decode())
    if not tree["scores"]:
        return str(tree["reason"])
    return [Score(work.case.name, method, 0, measure, value) for method, measure, value in tree["scores"]]


def _inbetween(work: SetWork) -> dict[str, Any]:
    from wildpuppet.motion.score import leave_one_out
    from wildpuppet.tables.inbetweens import inbetween_rows, inbetween_scores
    from wildpuppet.tables.sheet import grid, save_sheet

    def picture(frame: int) -> Picture:
        return work.drawings[frame]

    run = work.ran("ours", ours_settings(work))
    left_out = leave_one_out(
        run.puppet, run.crops, run.fit, work.truth, picture, only=tuple(work.test.tolist()), progress=_progress(work)
    )
    if left_out.frames:
        rows = inbetween_rows(run.puppet, run.crops, run.fit, picture, left_out.frames[:ROWS])
        save_sheet(work.out / "figures" / f"{work.case.name}-inbetween.png", grid(rows))
    means = inbetween_scores(left_out).items()
    return {
        "scores": [[method, f"inbetween {measure}", value] for (method, measure), value in means],
        "reason": "no test drawing lies between two drawings of one motion that are not doubted",
        "frames": list(left_out.frames),
        "skipped": left_out.skipped,
    }


def _drag(work: SetWork) -> dict[str, Any]:
    from wildpuppet.tables.drags import drag_rows, drag_scores
    from wildpuppet.tables.sheet import grid, save_sheet

    run = work.ran("ours", ours_settings(work))
    parts = (run.puppet, run.crops, run.fit, work.truth)
    found = drag_scores(*parts, most=DRAGGED, progress=_progress(work))
    if found.errors:
        rows = drag_rows(*parts, lambda frame: work.drawings[frame], ROWS)
        save_sheet(work.out / "figures" / f"{work.case.name}-drag.png", grid(rows))
    return {
        "scores": [[method, f"drag {count}", found.mean(method, count)] for method, count in found.errors],
        "reason": "fewer than two training drawings are not doubted, or no point is right in them",
        "drawings": list(found.frames),
    }


APPLICATIONS: dict[str, Callable[[SetWork], dict[str, Any]]] = {"inbetween": _inbetween, "drag": _drag}


def _progress(work: SetWork) -> Callable[[int, int], None]:
    return lambda done, total: work.reporter.update(done / max(total, 1))
