"""How to compute, never what: device, threads and the progress callback. Nothing here enters a result's key."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Progress = Callable[[int, int], None]
"""Called as ``progress(done, total)``, with ``done`` rising from 0 to ``total``."""

Device = Literal["auto", "cpu", "cuda"]


def silent(done: int, total: int) -> None:
    """Report progress to nobody."""


@dataclass(frozen=True)
class Machine:
    """What a stage may use of the computer.

    ``device`` "auto" takes CUDA where torch finds it. ``workers`` bounds threads; 0 means one per processor.
    """

    device: Device = "auto"
    workers: int = 0
    progress: Progress = silent

    @property
    def num_threads(self) -> int:
        """Number of threads to run, at least 1."""
        return self.workers or os.cpu_count() or 1
