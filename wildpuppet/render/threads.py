"""Run a kernel over the frames of a batch on several threads (the kernels let go of Python's lock).

Plain threads rather than Numba's parallel loops: they compile faster, survive a fork, and may be used from several
Python threads at once.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


class _Pool:
    """The process's one pool and its size."""

    num_threads = os.cpu_count() or 1
    executor: ThreadPoolExecutor | None = None

    @classmethod
    def reset(cls) -> None:
        """Forget the pool (a forked child has none of its threads)."""
        cls.executor = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_Pool.reset)


def use_threads(num_threads: int) -> None:
    """Set how many threads the CPU renderer uses from now on, in this process."""
    if num_threads < 1:
        raise ValueError(f"num_threads must be at least 1, not {num_threads}")
    _Pool.num_threads = num_threads
    _Pool.reset()


def shares(num_frames: int, num_shares: int | None = None) -> list[tuple[int, int]]:
    """Cut 0..num_frames into runs (first, end), at most one per thread or ``num_shares`` of them."""
    count = min(num_frames, num_shares or _Pool.num_threads)
    return [(num_frames * i // count, num_frames * (i + 1) // count) for i in range(count)]


def run_shares(work: Callable[[int, int, int], None], runs: list[tuple[int, int]]) -> None:
    """Call ``work(index, first, end)`` for each run, on threads where there are several; raises what they raise."""
    if len(runs) < 2 or _Pool.num_threads == 1:
        for index, (first, end) in enumerate(runs):
            work(index, first, end)
        return
    if _Pool.executor is None:
        _Pool.executor = ThreadPoolExecutor(_Pool.num_threads, "render")
    futures = [_Pool.executor.submit(work, index, *run) for index, run in enumerate(runs)]
    for future in futures:
        future.result()
