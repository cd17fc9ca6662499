"""`wildpuppet formats`: what a run can be exported to, what opens it, how exact it is; what puppets come from."""

import sys
from dataclasses import dataclass
from itertools import zip_longest


@dataclass(frozen=True)
class Arguments:
    """List the formats of `wildpuppet export` and those of `wildpuppet puppet import`."""


def main(arguments: Arguments) -> None:
    """Print both tables."""
    import shutil

    from wildpuppet.export.formats import HEADINGS, rows
    from wildpuppet.puppet.imports import formats as imports

    width = shutil.get_terminal_size((160, 24)).columns
    sys.stdout.write(table([HEADINGS, *rows()], width))
    sys.stdout.write(f"\nwildpuppet puppet import reads:\n\n{table([imports.HEADINGS, *imports.rows()], width)}")


def table(cells: list[tuple[str, ...]], width: int) -> str:
    """Lay rows out in columns; long cells go on below within ``width``, unless it is too narrow for any table.

    What stands first is a name and stays in one piece.
    """
    import textwrap

    sides = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    spare = width - 2 * (len(sides) - 1)
    while sum(sides) > spare and max(sides[1:]) > 16:
        sides[1 + sides[1:].index(max(sides[1:]))] -= 1
    lines = []
    for row in cells:
        wrapped = [textwrap.wrap(cell, side) or [""] for cell, side in zip(row, sides, strict=True)]
        for parts in zip_longest(*wrapped, fillvalue=""):
            lines.append("  ".join(part.ljust(side) for part, side in zip(parts, sides, strict=True)).rstrip())
    return "".join(f"{line}\n" for line in lines)
