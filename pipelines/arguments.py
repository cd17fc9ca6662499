"""Turning the command line into a dataclass by tyro, with mistakes told in one line instead of a box."""

import contextlib
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import tyro

from wildpuppet.errors import SettingsError

T = TypeVar("T")

BOX_FLAG = "--bbox"


def parse(kind: type[T], argv: Sequence[str], program: str, default: T | None = None) -> T:
    """Parse ``argv`` into a ``kind``; raises SettingsError, one line, for what it does not understand."""
    complaint = io.StringIO()
    more: dict[str, Any] = {} if default is None else {"default": default}
    try:
        with contextlib.redirect_stderr(complaint):
            parsed: T = tyro.cli(kind, args=list(argv), prog=program, config=(tyro.conf.FlagConversionOff,), **more)
        return parsed
    except SystemExit as end:
        if end.code in (0, None):
            raise
        raise SettingsError(one_line(complaint.getvalue(), program)) from None


def one_line(box: str, program: str) -> str:
    """Flatten tyro's box (drawn in lines, or bare where the terminal has none) to its first sentence and flags."""
    rows = [re.sub(r"[╭╮╰╯│─]|-{3,}", " ", row).strip() for row in box.splitlines()[1:]]
    rows = [row for row in rows if row and not row.startswith("For full helptext")]
    if not rows:
        return f"cannot understand these arguments; see {program} --help"
    first = rows[0]
    flags = [row for row in rows[1:] if row.startswith("--") and "helptext" not in row and row != f"{program} --help"]
    if first.startswith("Unrecognized options"):
        return f"unknown {_unknown(first)}{_suggestion(flags)}; see {program} --help"
    if first.startswith("Missing from"):
        missing = [row for row in rows[1:] if re.match(r"--|[A-Z][\w.|-]*$", row)]
        return f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} needed; see {program} --help"
    if first.startswith("Error parsing"):
        first = rows[0] = _expected_number(first)
    words = " ".join(row for row in rows if not row.startswith("in wildpuppet")).partition(" Argument helptext")[0]
    return f"{words.rstrip('.')}; see {program} --help"


def _expected_number(row: str) -> str:
    """Say in words what Python says of a number that is none; other rows stay."""
    parts = re.match(
        r"Error parsing (--\S+): (invalid literal for int|could not convert string to float).*?('.*')", row
    )
    if parts is None:
        return row
    kind = "a whole number" if "int" in parts[2] else "a number"
    return f"{parts[1]}: expected {kind}, found {parts[3]}"


def _unknown(row: str) -> str:
    tokens = row.partition(":")[2].strip().split(", ")
    flags = [token for token in tokens if token.startswith("-")]
    return f"setting {flags[0]}" if flags else f"argument {tokens[0]}"


def _suggestion(flags: list[str]) -> str:
    names = [flag.split()[0].rstrip(",") for flag in flags]
    return f"; did you mean {' or '.join(names[:2])}?" if names else ""


def with_split_box(argv: Sequence[str]) -> list[str]:
    """Turn ``--bbox X,Y,W,H`` and ``--bbox=X,Y,W,H`` into four tokens; raises SettingsError for anything else."""
    found: list[str] = []
    for index, token in enumerate(argv):
        name, equals, value = token.partition("=")
        if name == BOX_FLAG and equals:
            found += [BOX_FLAG, *_four(value)]
        elif index and argv[index - 1] == BOX_FLAG and "," in token:
            found += _four(token)
        else:
            found.append(token)
    return found


def _four(text: str) -> list[str]:
    numbers = [number.strip() for number in text.split(",")]
    try:
        for number in numbers:
            float(number)
    except ValueError:
        numbers = []
    if len(numbers) != 4:
        raise SettingsError(f"--bbox {text}: expected four numbers X,Y,W,H, as in --bbox 285,125,275,318")
    return numbers


def value_of(argv: Sequence[str], flag: str) -> str:
    """Give what follows ``flag`` on the command line; empty when it is not there."""
    for index, token in enumerate(argv):
        if token == flag and index + 1 < len(argv):
            return argv[index + 1]
        if token.startswith(f"{flag}="):
            return token.partition("=")[2]
    return ""


def first_path(argv: Sequence[str]) -> Path | None:
    """Give the first argument when it is not a flag."""
    return Path(argv[0]) if argv and not argv[0].startswith("-") else None
