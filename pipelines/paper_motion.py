"""Table 3 of the paper's tables: drawings left out and predicted from their neighbours, on our own runs.

What is measured is kept in OUT/sets/SET/inbetween.json as long as the set's files, the settings and the stages stay.
"""

from typing import TYPE_CHECKING, Any

import msgspec

from wildpuppet.errors import WildPuppetError
from wildpuppet.store import digest_of, read_json

from .paper_tables import stages_of
from .paper_work import SetWork, ours_settings

if TYPE_CHECKING:
    from wildpuppet.tables.table import Score

VERSION = 1
SCHEMA = "wildpuppet.inbetween-scores/1"
ROWS = 4
"""Rows of a figure."""


def inbetween(work: SetWork) -> "list[Score] | str":
    """Give the scores of inbetweens, kept or new, and draw their figure; a reason in words where there are none."""
    from wildpuppet import atomic
    from wildpuppet.tables.table import Score

    path = work.out / "sets" / work.case.name / "inbetween.json"
    identity = digest_of([VERSION, work.content, stages_of(ours_settings)(work)])
    tree = read_json(path) if path.is_file() else {}
    if (tree.get("schema"), tree.get("identity")) != (SCHEMA, identity):
        try:
            tree = {"schema": SCHEMA, "identity": identity, **_measured(work)}
        except WildPuppetError as error:
            return str(error)
        atomic.write_text(path, msgspec.json.format(msgspec.json.encode(tree), indent=1).decode())
    if not tree["frames"]:
        return "no test drawing lies between two drawings of one motion that are not doubted"
    name = work.case.name
    return [Score(name, method, 0, f"inbetween {measure}", value) for method, measure, value in tree["scores"]]


def _measured(work: SetWork) -> dict[str, Any]:
    from wildpuppet.motion.score import leave_one_out
    from wildpuppet.tables.inbetweens import inbetween_rows, inbetween_scores
    from wildpuppet.tables.sheet import grid, save_sheet

    def picture(frame: int) -> Any:
        return work.drawings[frame]

    run = work.ran("ours", ours_settings(work))
    only = tuple(work.test.tolist())
    work.reporter.begin("inbetween")
    left_out = leave_one_out(
        run.puppet, run.crops, run.fit, work.truth, picture, only=only,
        progress=lambda done, total: work.reporter.update(done / max(total, 1)),
    )  # fmt: skip
    if left_out.frames:
        rows = inbetween_rows(run.puppet, run.crops, run.fit, picture, left_out.frames[:ROWS])
        save_sheet(work.out / "figures" / f"{work.case.name}-inbetween.png", grid(rows))
    work.reporter.end("inbetween", False)
    scores = [[method, measure, value] for (method, measure), value in inbetween_scores(left_out).items()]
    return {"frames": list(left_out.frames), "skipped": left_out.skipped, "scores": scores}
