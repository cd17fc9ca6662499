"""How the long stages are cut into chunks, and what each chunk is told."""

from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np

from pipelines import fit_frames
from wildpuppet import stages
from wildpuppet.store import given


class Recording:
    """A keeper that makes nothing and remembers what it was asked for."""

    def __init__(self):
        self.asked = []

    @contextmanager
    def step(self, name, total):
        yield

    def keep(self, stage, **inputs):
        self.asked.append((stage, inputs))
        return given(None, f"result {len(self.asked)}")


def test_a_chunk_starts_from_the_size_before_it_but_not_across_a_cut(monkeypatch):
    monkeypatch.setattr(fit_frames, "CHUNK", 2)
    crops = given(SimpleNamespace(shot=np.array([0, 0, 1, 1, 1, 1, 2])), "crops")
    keeper = Recording()
    fit_frames.search(keeper, given(None, "puppet"), crops, given(None, "placement"), fit_frames.Frames(7, 3))
    parts = [inputs for stage, inputs in keeper.asked if stage is stages.SEARCH_PART]
    told = [(inputs["frames"].value.tolist(), inputs["size"].digest) for inputs in parts]
    assert told == [
        ([3, 4], ["size", "placement"]),
        ([5], ["size_after", "result 1"]),
        ([6], "as expected"),
        ([2], ["size", "placement"]),
        ([1, 0], "as expected"),
    ]
    assert parts[2]["size"].value is parts[4]["size"].value is None
    joined = next(inputs for stage, inputs in keeper.asked if stage is stages.SEARCH)
    assert joined["frames"].value == [3, 4, 5, 6, 2, 1, 0]
