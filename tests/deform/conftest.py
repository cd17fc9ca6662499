from dataclasses import replace

import pytest
import torch

from tests.scenes import Scene, make_scene
from wildpuppet.puppet.build import build
from wildpuppet.settings import FitSettings, PuppetSettings
from wildpuppet.types import Puppet

torch.set_num_threads(1)
SMALL_AREA = 0.03
"""The area weight for pictures half as large as usual: areas go with the square of the size, their squares with its
fourth power."""


@pytest.fixture(scope="session")
def scene() -> Scene:
    """The first drawings of a crossing: arms and legs have turned by up to 40 degrees."""
    whole = make_scene("crossing", frames=12, size=(112, 84), cycles=0.5)
    names = ("frames", "video_from_canvas", "boxes", "order", "alpha", "drawing")
    return replace(whole, **{name: getattr(whole, name)[:4] for name in names})


@pytest.fixture(scope="session")
def puppet(scene: Scene) -> Puppet:
    return build(scene.cutout, PuppetSettings(edge=0.1))


@pytest.fixture(scope="session")
def fit_settings() -> FitSettings:
    return FitSettings(area=SMALL_AREA)
