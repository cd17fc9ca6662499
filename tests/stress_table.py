"""Fit every stress clip and print the scores as a markdown table, for docs/accuracy.md.

python -m tests.stress_table [NAME ...]
"""

import sys
import tempfile
from pathlib import Path

from tests.scenes import STRESS
from tests.stress.judge import Judged, judge

HEADS = ("clip", "what is hard", "PCK .1", ".05", ".025", "hidden .1", "visible", "order", "swaps", "lost")


def cells(name: str, found: Judged) -> tuple[str, ...]:
    hidden = found.score.hidden
    shares = [*(found.score.pck[alpha] for alpha in (0.1, 0.05, 0.025)), hidden[0.1] if hidden else None]
    shares += [found.visible_right, 100 * found.order_right[found.clear].mean(), found.score.swaps, found.lost_right]
    return name, STRESS[name].what, *("" if share is None else f"{share:.1f}" for share in shares)


def row(texts: tuple[str, ...]) -> str:
    return f"| {' | '.join(texts)} |\n"


def main(names: list[str]) -> None:
    unknown = set(names) - set(STRESS)
    if unknown:
        sys.exit(f"expected some of {', '.join(STRESS)}, found {', '.join(sorted(unknown))}")
    sys.stdout.write(row(HEADS) + row(("---", "---", *["---:"] * (len(HEADS) - 2))))
    for name in names or STRESS:
        with tempfile.TemporaryDirectory() as folder:
            sys.stdout.write(row(cells(name, judge(name, Path(folder)))))
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
