"""Telling a person how far a run is: bars with the time left on a terminal, one line per step to stderr elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.progress import TimeRemainingColumn as Remaining


class Reporter(Protocol):
    """Hears about steps; ``share`` of a step's work lies between 0 and 1."""

    def begin(self, step: str) -> None:
        """A step starts."""

    def update(self, share: float) -> None:
        """So much of it is done."""

    def end(self, step: str, is_kept: bool) -> None:
        """It is done; nothing of it had to be made when ``is_kept``."""


class Silent:
    """Tells nobody."""

    def begin(self, step: str) -> None:
        """Do nothing."""

    def update(self, share: float) -> None:
        """Do nothing."""

    def end(self, step: str, is_kept: bool) -> None:
        """Do nothing."""


class Lines:
    """One line on stderr when a step is done."""

    def __init__(self) -> None:
        self.started = 0.0

    def begin(self, step: str) -> None:
        """Start the clock."""
        self.started = time.monotonic()

    def update(self, share: float) -> None:
        """Do nothing: not a terminal."""

    def end(self, step: str, is_kept: bool) -> None:
        """Write the line."""
        took = "kept" if is_kept else f"{time.monotonic() - self.started:.1f} s"
        sys.stderr.write(f"{step}: {took}\n")


class Bars:
    """A bar per step with the time left."""

    def __init__(self) -> None:
        columns = (TextColumn("{task.description:<9}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
        self.progress = Progress(*columns, Remaining(), console=Console(stderr=True))
        self.progress.start()
        self.task: TaskID | None = None

    def begin(self, step: str) -> None:
        """Show a new bar."""
        self.task = self.progress.add_task(step, total=1.0)

    def update(self, share: float) -> None:
        """Move the bar."""
        if self.task is not None:
            self.progress.update(self.task, completed=min(share, 1.0))

    def end(self, step: str, is_kept: bool) -> None:
        """Fill the bar."""
        if self.task is not None:
            self.progress.update(self.task, completed=1.0, description=f"{step} (kept)" if is_kept else step)

    def close(self) -> None:
        """Leave the terminal as it was."""
        self.progress.stop()


@contextmanager
def terminal() -> Iterator[Reporter]:
    """Report with bars when stderr is a terminal, else with lines."""
    if not sys.stderr.isatty():
        yield Lines()
        return
    bars = Bars()
    try:
        yield bars
    finally:
        bars.close()


def progress_of(reporter: Reporter) -> Callable[[int, int], None]:
    """Give what tells a reporter how much is done of how much."""
    return lambda done, total: reporter.update(done / max(total, 1))


def note(reporter: Reporter, text: str) -> None:
    """Write a line between the bars, or to stderr; a silent reporter stays silent."""
    if isinstance(reporter, Bars):
        reporter.progress.console.print(text, highlight=False)
    elif isinstance(reporter, Lines):
        sys.stderr.write(f"{text}\n")
