"""Names that a file system, a scene graph or a script takes: parts may be called anything."""

import re
import unicodedata
from collections.abc import Iterable, Sequence

RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
"""Names that Windows keeps for devices."""


def identifiers(names: Sequence[str], taken: Iterable[str] = ()) -> tuple[str, ...]:
    """Turn names into unique ASCII identifiers (letters, digits, underscores, no digit first), none of ``taken``."""
    return _unique([_identifier(name) for name in names], taken)


def file_names(names: Sequence[str]) -> tuple[str, ...]:
    """Turn names into unique file stems that every system takes, also where case makes no difference."""
    stems = [re.sub(r"[^\w.-]+", "_", _plain(name)).strip("._")[:60] or "part" for name in names]
    return _unique([f"{stem}_" if RESERVED.fullmatch(stem) else stem for stem in stems])


def printable(name: str) -> str:
    """Put question marks for control characters, which XML does not have, whatever the escape."""
    return "".join("?" if unicodedata.category(letter) in ("Cc", "Cs") else letter for letter in name)


def _plain(name: str) -> str:
    return unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()


def _identifier(name: str) -> str:
    word = re.sub(r"\W+", "_", _plain(name)).strip("_") or "part"
    return word if not word[0].isdigit() else f"_{word}"


def _unique(words: Sequence[str], taken: Iterable[str] = ()) -> tuple[str, ...]:
    """Number the words that come again, whatever their case."""
    used, unique = {word.lower() for word in taken}, []
    for word in words:
        chosen, number = word, 1
        while chosen.lower() in used:
            number += 1
            chosen = f"{word}_{number}"
        used.add(chosen.lower())
        unique.append(chosen)
    return tuple(unique)
