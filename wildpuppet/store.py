"""Content-addressed results: a result is kept under what it was made of, so nothing is ever made twice.

The key of a result is BLAKE2b of canonical JSON [stage, version, settings, {input: digest of its content}]. Inputs
count by content, not by how they were made; device and threads count nowhere. A result is a folder of data files
beside a ``record.json`` that says what it is; it is written beside and renamed into place, so it is there whole or not
at all, and whoever comes second to a name uses what is there. Reading a kept result reads its record and nothing else
until the value is asked for.

    STORE/store.json              schema
    STORE/entries/ab/abcd.../     record.json and the data files of one result
    STORE/working/abcd.../        checkpoints of a result that is not finished
    STORE/runs/NAME.json          which results a run uses: what ``prune`` keeps and ``status`` compares with
"""

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

from wildpuppet import atomic
from wildpuppet.errors import StoreError

T = TypeVar("T")
S = TypeVar("S")

FORMAT = "wildpuppet.store"
FORMAT_VERSION = 1
RECORD = "record.json"


def canonical(value: Any) -> str:
    """Write plain values as JSON in the one way that keys and digests are made of."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def digest_of(value: Any) -> str:
    """Give the digest of a plain value (numbers, strings, lists, dicts)."""
    return hashlib.blake2b(canonical(value).encode(), digest_size=20).hexdigest()


def digest_of_file(path: Path) -> str:
    """Give the digest of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=20)).hexdigest()


def digest_of_folder(folder: Path) -> tuple[str, dict[str, int]]:
    """Give the digest of the files under a folder (names and bytes; no record) and each file's size."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != RECORD)
    names = [path.relative_to(folder).as_posix() for path in files]
    digest = digest_of({name: digest_of_file(path) for name, path in zip(names, files, strict=True)})
    return digest, {name: path.stat().st_size for name, path in zip(names, files, strict=True)}


@dataclass(frozen=True)
class Question:
    """What a result is asked for by: everything that its content may depend on."""

    stage: str
    version: int
    settings: Mapping[str, Any]
    inputs: Mapping[str, Any]

    @cached_property
    def key(self) -> str:
        """The name of the answer in the store."""
        return digest_of([self.stage, self.version, self.settings, self.inputs])


@dataclass(frozen=True)
class Entry:
    """A result that is in the store."""

    question: Question
    digest: str
    files: Mapping[str, int]
    seconds: float
    folder: Path

    @property
    def key(self) -> str:
        """Its name in the store."""
        return self.question.key


@dataclass(eq=False)
class Kept(Generic[T]):
    """A value that is known by its content and read when first asked for."""

    digest: Any
    load: Callable[[], T]
    entry: Entry | None = field(default=None, repr=False)

    @cached_property
    def value(self) -> T:
        """The value itself."""
        return self.load()

    def then(self, change: Callable[[T], T]) -> "Kept[T]":
        """Give the same result with something added when it is read that its digest does not cover."""
        return Kept(self.digest, lambda: change(self.load()), self.entry)

    def derived(self, how: str, function: Callable[[T], S]) -> "Kept[S]":
        """Give what ``function`` makes of the value, known by the value's digest and the word ``how``."""
        return Kept(None if self.digest is None else [how, self.digest], lambda: function(self.value))


def given(value: S, digest: Any = None) -> Kept[S]:
    """Wrap a value that no stage made; without ``digest`` the value itself (plain) stands for its content."""
    return Kept(value if digest is None else digest, lambda: value)


def check_format(name: str, found: Any, path: Path) -> None:
    """Raise StoreError unless ``found`` is schema ``name``/VERSION of a version that this program reads."""
    schema, _, version = str(found).rpartition("/")
    if schema != name or not version.isdigit():
        raise StoreError(f"{path}: expected schema {name}/{FORMAT_VERSION}, found {found!r}; is this our folder?")
    if int(version) > FORMAT_VERSION:
        raise StoreError(
            f"{path}: written by a newer wildpuppet (schema {found}, this one reads up to {name}/{FORMAT_VERSION}); "
            "update wildpuppet or give another folder"
        )


def read_json(path: Path) -> Any:
    """Read a JSON file; raises StoreError when it is damaged and FileNotFoundError when it is not there."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, UnicodeDecodeError) as error:
        raise StoreError(f"{path}: not readable JSON ({error}); remove the file and run again") from None
    except PermissionError:
        raise StoreError(f"{path}: no permission to read it; make it readable or give another --store") from None


@dataclass(frozen=True)
class Pruned:
    """What ``Store.prune`` removed."""

    entries: int
    leftovers: int
    num_bytes: int


class Store:
    """A folder of results. Opening one makes nothing; the first result that is kept does."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        if folder.exists() and not folder.is_dir():
            raise StoreError(f"{folder}: expected a folder for the store, found a file; give another --store")
        mark = folder / "store.json"
        is_used = folder.is_dir() and any(not item.name.startswith(atomic.PREFIX) for item in folder.iterdir())
        if mark.exists():  # asked last: another process may be making the store, its mark first
            check_format(FORMAT, read_json(mark).get("schema"), mark)
        elif is_used:
            raise StoreError(f"{folder}: not empty and not a store (no store.json); give another folder with --store")

    def _prepare(self) -> None:
        mark = self.folder / "store.json"
        if not mark.exists():
            atomic.write_text(mark, canonical({"schema": f"{FORMAT}/{FORMAT_VERSION}"}) + "\n")
            atomic.write_text(self.folder / ".gitignore", "*\n")

    def _place(self, key: str) -> Path:
        return self.folder / "entries" / key[:2] / key

    def look_up(self, question: Question) -> Entry | None:
        """Find the answer to a question; an entry whose files are not as recorded is set aside and not given."""
        return self.entry(question.key)

    def entry(self, key: str) -> Entry | None:
        """Find a result by its key."""
        folder = self._place(key)
        try:
            record = read_json(folder / RECORD)
        except FileNotFoundError:
            return None
        check_format(FORMAT, record.get("schema"), folder / RECORD)
        question = Question(record["stage"], record["version"], record["settings"], record["inputs"])
        entry = Entry(question, record["digest"], record["files"], record["seconds"], folder)
        if not _is_whole(entry):
            self._remove(folder)
            return None
        return entry

    def publish(self, question: Question, write: Callable[[Path], float], *, anew: bool = False) -> Entry:
        """Keep the answer whose files ``write`` puts into a folder (it gives the seconds it took to make).

        Somebody else's answer that is there first is used instead, unless ``anew`` asks to replace it.
        Raises StoreError when the disk refuses.
        """
        self._prepare()
        place = self._place(question.key)
        with atomic.new_folder(self.folder / "entries") as folder, atomic.disk_errors(self.folder):
            seconds = write(folder)
            _seal(folder, question, seconds)
            place.parent.mkdir(parents=True, exist_ok=True)
            if anew:
                self._remove(place)
            try:
                folder.rename(place)
                atomic.flush(place.parent)
            except OSError:
                if not (place / RECORD).exists():
                    raise
        shutil.rmtree(self._working(question.key), ignore_errors=True)
        entry = self.look_up(question)
        if entry is None:
            raise StoreError(f"{place}: vanished while it was being kept; is the store being cleared? Run again")
        return entry

    def _remove(self, place: Path) -> None:
        """Take an entry away in one step, so that nobody reads half of it."""
        if not place.exists():
            return
        with atomic.new_folder(self.folder / "entries") as aside:
            try:
                place.rename(aside / place.name)
            except FileNotFoundError:
                return  # somebody else removed it

    def _working(self, key: str) -> Path:
        return self.folder / "working" / key

    @contextmanager
    def working(self, question: Question) -> Iterator[Path]:
        """Give a folder for checkpoints that outlives a killed run and goes when the answer is published."""
        self._prepare()
        folder = self._working(question.key)
        with atomic.disk_errors(self.folder):
            folder.mkdir(parents=True, exist_ok=True)
            yield folder

    def note_run(self, name: str, note: Mapping[str, Any]) -> None:
        """Write down which results a run uses (``note["keys"]``), so that ``prune`` keeps them."""
        self._prepare()
        atomic.write_text(self.folder / "runs" / f"{name}.json", json.dumps(note, indent=1, sort_keys=True) + "\n")

    def runs(self) -> dict[str, dict[str, Any]]:
        """Give the notes of all runs by name, newest last; other runs may write and forget theirs meanwhile."""
        found: list[tuple[int, str, dict[str, Any]]] = []
        for path in (self.folder / "runs").glob("*.json"):
            if path.name.startswith(atomic.PREFIX):
                continue  # not whole yet
            with suppress(FileNotFoundError):
                found.append((path.stat().st_mtime_ns, path.stem, read_json(path)))
        return {name: note for _, name, note in sorted(found, key=lambda one: one[:2])}

    def forget_run(self, name: str) -> None:
        """Remove a run's note."""
        (self.folder / "runs" / f"{name}.json").unlink(missing_ok=True)

    def prune(self) -> Pruned:
        """Clear results that no noted run uses, checkpoints of such, and what killed processes left behind."""
        used = {key for note in self.runs().values() for key in note["keys"]}
        with atomic.disk_errors(self.folder):
            unused = [place for place in sorted(self.folder.glob("entries/??/*")) if place.name not in used]
            unused += [place for place in sorted(self.folder.glob("working/*")) if place.name not in used]
            num_bytes = sum(_num_bytes(place) for place in unused)
            for place in unused:
                self._remove(place)
            return Pruned(len(unused), atomic.clear_abandoned(self.folder / "entries"), num_bytes)


def _is_whole(entry: Entry) -> bool:
    """Say whether each data file is there with the size that the record gives."""
    for name, size in entry.files.items():
        path = entry.folder / name
        if not path.is_file() or path.stat().st_size != size:
            return False
    return True


def _num_bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _seal(folder: Path, question: Question, seconds: float) -> None:
    """Write the record last, after the data files are on the disk."""
    digest, files = digest_of_folder(folder)
    for name in files:
        atomic.flush(folder / name)
    record = {
        "schema": f"{FORMAT}/{FORMAT_VERSION}",
        "stage": question.stage,
        "version": question.version,
        "settings": question.settings,
        "inputs": question.inputs,
        "digest": digest,
        "files": files,
        "seconds": round(seconds, 3),
    }
    path = folder / RECORD
    path.write_text(json.dumps(record, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    atomic.flush(path)


def why(asked: Question, last: Question | None) -> str:
    """Say in words what changed between the last time a stage ran and now, as in 'settings.fit.area 0.05 -> 0.2'."""
    if last is None:
        return "it never ran"
    changes = [f"version {last.version} -> {asked.version}"] if last.version != asked.version else []
    before, now = dict(_flat("settings", last.settings)), dict(_flat("settings", asked.settings))
    for name in sorted(before.keys() | now.keys()):
        if canonical(before.get(name)) != canonical(now.get(name)):
            changes.append(f"{name} {_short(before.get(name))} -> {_short(now.get(name))}")
    changed = [name for name in asked.inputs if canonical(asked.inputs[name]) != canonical(last.inputs.get(name))]
    changes += [f"{name} changed" for name in changed]
    return ", ".join(changes) or "its result is no longer in the store"


def _flat(prefix: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{prefix}.{name}", inner)
    else:
        yield prefix, value


def _short(value: Any) -> str:
    return "none" if value is None else canonical(value).strip('"')
