"""JSON written piece by piece: an export of a long clip never stands in memory as a tree of Python numbers.

Mappings and lists are as in ``json``; an iterator is an array whose items are made when they are written; a numpy array
is a flat array of numbers, rounded to ``DECIMALS``. Whole numbers lose their ``.0``, which is a fifth of such files.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any, TextIO

import numpy as np

DECIMALS = 4
"""Of coordinates in pixels: 0.00005 px at most is lost. Fewer make smaller files; 2 is the least that nobody sees."""
Json = Mapping[str, Any] | Iterator[Any] | list[Any] | tuple[Any, ...] | np.ndarray | str | float | bool | None


def write_json(file: TextIO, value: Json, is_ascii: bool = False) -> None:
    """Write ``value``, letters beyond ASCII as they are or escaped.

    Raises ValueError for numbers that are not finite, which JSON does not have.
    """
    if isinstance(value, Mapping):
        labelled = ((json.dumps(name, ensure_ascii=is_ascii) + ":", item) for name, item in value.items())
        _enclosed(file, "{}", labelled, is_ascii)
    elif isinstance(value, Iterator | list | tuple):
        _enclosed(file, "[]", (("", item) for item in value), is_ascii)
    elif isinstance(value, np.ndarray):
        file.write(numbers(value))
    else:
        file.write(json.dumps(value, ensure_ascii=is_ascii, allow_nan=False))


def _enclosed(file: TextIO, brackets: str, items: Iterator[tuple[str, Any]], is_ascii: bool) -> None:
    file.write(brackets[0])
    for place, (label, item) in enumerate(items):
        file.write(("," if place else "") + label)
        write_json(file, item, is_ascii)
    file.write(brackets[1])


def numbers(values: np.ndarray) -> str:
    """Write an array of any shape as one flat list."""
    flat = np.asarray(values).ravel()
    if not np.issubdtype(flat.dtype, np.floating):
        return json.dumps(flat.tolist(), separators=(",", ":"))
    rounded = np.round(flat.astype(np.float64), DECIMALS) + 0.0  # never -0.0
    return json.dumps(rounded.tolist(), separators=(",", ":"), allow_nan=False).replace(".0,", ",").replace(".0]", "]")
