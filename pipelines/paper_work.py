"""What the paper's tables share on one benchmark set: its files, runs and settings, and how long things are trained."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.settings import RefineSettings, Settings

from . import evaluate
from .evaluate import Case
from .presets import merged, read_preset
from .reporter import Reporter

if TYPE_CHECKING:
    from wildpuppet.api import Run
    from wildpuppet.correspond.pck import Truth

Picture = UInt8[np.ndarray, "H W 3"]


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How long things are trained; ``paper`` are changes of the paper preset's [train]."""

    autoencoder_steps: int
    refine: RefineSettings
    paper: Mapping[str, int] = field(default_factory=dict)

    @property
    def paper_iterations(self) -> int:
        """Steps for which the paper's network is trained."""
        return self.paper.get("iterations", read_preset("paper").train.iterations)


QUICK = Effort(
    autoencoder_steps=20,
    refine=RefineSettings(iterations=8, critic_steps=1, width=8),
    paper={"iterations": 4, "batch": 2},
)


@dataclass(frozen=True, kw_only=True)
class SetWork:
    """One benchmark set with what its methods share. ``content`` is the digest of its files."""

    case: Case
    content: str
    out: Path
    options: evaluate.Arguments
    effort: Effort
    reporter: Reporter

    @cached_property
    def truth(self) -> "Truth":
        """The ground truth."""
        from wildpuppet.correspond.pck import read_truth

        return read_truth(self.case.truth)

    @cached_property
    def drawings(self) -> list[Picture]:
        """All drawings over white."""
        from wildpuppet.export.source import source_of

        source = source_of(self.case.folder / "frames")
        return [source.picture(index) for index in range(len(self.truth.points))]

    @property
    def test(self) -> Int[np.ndarray, "A"]:
        """Numbers of the drawings kept for testing."""
        assert self.truth.test is not None, "sets without test drawings are refused before"
        return self.truth.test

    @property
    def tested(self) -> list[Picture]:
        """The drawings kept for testing."""
        return [self.drawings[index] for index in self.test]

    @cached_property
    def trained(self) -> list[Picture]:
        """The other drawings."""
        kept = set(self.test.tolist())
        return [picture for index, picture in enumerate(self.drawings) if index not in kept]

    @property
    def points(self) -> Float[np.ndarray, "A N 2"]:
        """True points of the test drawings."""
        return np.asarray(self.truth.points[self.test], np.float64)

    def ran(self, name: str, settings: Settings) -> "Run":
        """Run the pipeline with these settings, or open what is kept."""
        options = replace(self.options, settings=settings, work=self.out / "runs" / name)
        return evaluate.run_case(self.case, self.truth, options, self.reporter)


def ours_settings(work: SetWork) -> Settings:
    """Give the settings of our own run: those of the command line."""
    return work.options.settings


def paper_settings(work: SetWork, seed: int = 0) -> Settings:
    """Give the paper preset's search, fit and training with a seed; crops and puppet are those of our own run."""
    preset = read_preset("paper")
    settings = msgspec.structs.replace(work.options.settings, search=preset.search, fit=preset.fit, train=preset.train)
    return merged(settings, {"train": {**work.effort.paper, "seed": seed}, "out": {"preview": False}})


def refine_settings(work: SetWork, seed: int = 0) -> RefineSettings:
    """Give our refinement's settings with a seed."""
    return msgspec.structs.replace(work.effort.refine, seed=seed)


def paper_refine_settings(work: SetWork, seed: int = 0) -> RefineSettings:
    """Give the paper's refinement: the rendered puppet alone goes in, the losses are as printed."""
    return msgspec.structs.replace(refine_settings(work, seed), method="network", squared=0.0)
