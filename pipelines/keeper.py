"""Runs stages through the store: what is kept is used, the rest is made, published and read back.

A result that was just made is read back from the store like a kept one, so an unbroken run and one that was killed
and run again see the same bytes.
"""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from wildpuppet.machine import Machine
from wildpuppet.settings import Settings
from wildpuppet.stages import Stage
from wildpuppet.store import Entry, Kept, Question, Store

from .reporter import Reporter, Silent

Inputs = Mapping[str, Kept[Any] | list[Kept[Any]]]


class ReachedEnd(Exception):  # noqa: N818 not an error: --until was reached
    """The stage that ``--until`` names is done."""


@dataclass(frozen=True)
class Used:
    """One result that a run used."""

    question: Question
    entry: Entry
    is_kept: bool


class Keeper:
    """Keeps every stage's result of one run. ``redo`` names a stage to make anew; ``until`` the last one to make."""

    def __init__(
        self,
        store: Store,
        settings: Settings,
        machine: Machine,
        reporter: Reporter | None = None,
        *,
        until: str | None = None,
        redo: str | None = None,
    ) -> None:
        self.store = store
        self.settings = settings
        self.machine = machine
        self.reporter = reporter or Silent()
        self.until = until
        self.redo = redo
        self.used: list[Used] = []
        self.name = ""
        self.note: dict[str, Any] = {}
        self._step: str | None = None
        self._done = 0.0
        self._total = 1.0

    def noted_as(self, name: str, note: Mapping[str, Any]) -> None:
        """Say under which name, and with what beside the keys, the store is to remember this run."""
        self.name, self.note = name, dict(note)

    def keep(self, stage: Stage, *, weight: float = 1.0, **inputs: Kept[Any] | list[Kept[Any]]) -> Kept[Any]:
        """Give a stage's result, made now unless it is kept. ``weight`` is its share of the step's work."""
        if self._step is None:
            with self.step(stage.name, weight):
                kept = self.keep(stage, weight=weight, **inputs)
        else:
            question = self._question(stage, inputs)
            entry = None if self._is_redone(stage) else self.store.look_up(question)
            is_kept = entry is not None
            if entry is None:
                self._write_note(question)
                entry = self._make(stage, question, inputs, weight)
            self.used.append(Used(question, entry, is_kept))
            self._done += weight
            self.reporter.update(self._done / self._total)
            kept = Kept(entry.digest, partial(stage.load, entry.folder), entry)
        return kept

    @contextmanager
    def step(self, name: str, total: float) -> Iterator[None]:
        """Report all that is kept inside as one step of ``total`` weight; the run ends after the step ``until``."""
        first = len(self.used)
        self._step, self._done, self._total = name, 0.0, total
        self.reporter.begin(name)
        try:
            yield
        finally:
            self._step = None
        self.reporter.end(name, all(used.is_kept for used in self.used[first:]))
        if name == self.until:
            raise ReachedEnd(name)

    def _is_redone(self, stage: Stage) -> bool:
        return self.redo is not None and stage.name.split(".")[0] == self.redo

    def _question(self, stage: Stage, inputs: Inputs) -> Question:
        tables = {name: msgspec.to_builtins(getattr(self.settings, name)) for name in stage.settings}
        digests = {
            name: [part.digest for part in kept] if isinstance(kept, list) else kept.digest
            for name, kept in inputs.items()
        }
        return Question(stage.name, stage.version, tables, digests)

    def _make(self, stage: Stage, question: Question, inputs: Inputs, weight: float) -> Entry:
        values = [[part.value for part in kept] if isinstance(kept, list) else kept.value for kept in inputs.values()]
        settings = [getattr(self.settings, name) for name in stage.settings]
        base = self._done

        def progress(done: int, total: int) -> None:
            self.reporter.update((base + weight * done / max(total, 1)) / self._total)

        machine = replace(self.machine, progress=progress)

        started = time.monotonic()
        if stage.has_checkpoint:
            with self.store.working(question) as working:
                value = stage.run(*values, *settings, machine, working / "checkpoint")
        else:
            value = stage.run(*values, *settings, machine)

        def write(folder: Path) -> float:
            stage.save(value, folder)
            return time.monotonic() - started

        return self.store.publish(question, write, anew=self._is_redone(stage))

    def _write_note(self, coming: Question | None = None) -> None:
        """Note what is used, and the coming result's key before it is made, so that prune leaves both alone."""
        if not self.name:
            return
        questions = [used.question for used in self.used] + ([coming] if coming else [])
        keys = [question.key for question in questions]
        self.store.note_run(self.name, {**self.note, "keys": keys, "stages": stage_list(questions)})

    def finish(self) -> None:
        """Note the finished run, and forget what was noted of earlier ones into the same OUT: they are written over."""
        self.note = {**self.note, "is_finished": True}
        self._write_note()
        for name, note in self.store.runs().items():
            if name != self.name and note["out"] == self.note["out"]:
                self.store.forget_run(name)

    def seconds(self) -> dict[str, float]:
        """Give the seconds that each step's results took when they were made."""
        seconds: dict[str, float] = {}
        for used in self.used:
            step = used.question.stage.split(".")[0]
            seconds[step] = round(seconds.get(step, 0.0) + used.entry.seconds, 3)
        return seconds


def flat_digests(inputs: Inputs) -> list[Any]:
    """List the digests of all inputs; None stands for a content that nobody knows yet."""
    return [part.digest for kept in inputs.values() for part in (kept if isinstance(kept, list) else [kept])]


def stage_list(questions: list[Question]) -> list[dict[str, Any]]:
    """Write questions as plain values, one per stage name (the first part stands for all of them)."""
    first = {question.stage: question for question in reversed(questions)}
    return [
        {
            "stage": question.stage,
            "key": question.key,
            "version": question.version,
            "settings": question.settings,
            "inputs": question.inputs,
        }
        for question in questions
        if first[question.stage] is question
    ]
