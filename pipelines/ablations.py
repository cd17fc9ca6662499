"""What can be switched off alone, to see what it is worth: a name, what it says, the settings that do it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from wildpuppet.errors import SettingsError
from wildpuppet.settings import Settings

from .presets import merged, read_preset

DEFAULT = "default"


@dataclass(frozen=True)
class Ablation:
    """``changes`` are laid over the settings at hand, or over those of ``preset``. A slow one runs only when named."""

    what: str
    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    preset: str = ""
    is_slow: bool = False


BONES_ONLY = ((0.3, 0.4, 0.0), (0.6, 0.35, 0.0), (1.0, 0.25, 0.0))
FULL_SIZE_ONLY = ((1.0, 0.5, 0.5),)

ABLATIONS = {
    DEFAULT: Ablation("the settings at hand"),
    "no-search": Ablation("the fit starts from the placed rest pose", {"search": {"enabled": False}}),
    "no-time": Ablation("each frame takes its own best pose", {"search": {"time_weight": 0.0}}),
    "no-coarse-search": Ablation("no coarse search before the fine one", {"search": {"coarse": 0.0}}),
    "one-hypothesis": Ablation("one pose per frame is kept for the choice over time", {"search": {"num_best": 1}}),
    "no-weighing": Ablation("a drawing's best pose in the search is fitted alone", {"fit": {"overrule": 0.0}}),
    "rigid-parts": Ablation("no part bends in the search", {"puppet": {"slender": 0.0}}),
    "drawn-lengths": Ablation("parts keep their lengths in the search", {"search": {"stretch": 0.0}}),
    "drawn-hinges": Ablation("hinges stand where the puppet has them", {"search": {"hinge_drawings": 0}}),
    "no-reorder": Ablation("the layers keep the puppet's order", {"search": {"reorder": 1.0e9}}),
    "coarse-angles": Ablation("the search tries a third of the angles", {"search": {"angles": 12}}),
    "coarse-search": Ablation("the search sees half the size", {"search": {"box_pixels": 36}}),
    "few-colours": Ablation("the search's templates have six colours", {"search": {"colours": 6}}),
    "no-matte": Ablation("nothing is known about the background", {"crop": {"matte": False}}),
    "no-holds": Ablation("held drawings are solved frame by frame", {"crop": {"hold_threshold": 0.0}}),
    "no-fit": Ablation("the search's poses as they are", {"fit": {"steps": 0}}),
    "bones-only": Ablation("parts move as wholes, meshes do not bend", {"fit": {"levels": BONES_ONLY}}),
    "no-pyramid": Ablation("the descent sees full size only", {"fit": {"levels": FULL_SIZE_ONLY}}),
    "not-robust": Ablation("squared differences", {"fit": {"robust": 1000.0}}),
    "no-matte-term": Ablation("the descent matches colours alone, no outline", {"fit": {"matte": 0.0}}),
    "no-arap": Ablation("meshes bend as they like", {"fit": {"arap": 25.0}}),
    "no-hinges": Ablation("parts come apart as they like", {"fit": {"joints": 0.0}}),
    "best": Ablation("the preset best", preset="best", is_slow=True),
    "fast": Ablation("the preset fast", preset="fast"),
    "paper": Ablation("the preset paper", preset="paper", is_slow=True),
}


def settings_of(name: str, at_hand: Settings) -> Settings:
    """Give an ablation's settings; raises SettingsError where they are none."""
    ablation = ABLATIONS[name]
    return merged(read_preset(ablation.preset) if ablation.preset else at_hand, ablation.changes)


def chosen(names: Sequence[str]) -> list[str]:
    """Give the ablations to run, the default first; all but the slow ones where none is named."""
    for name in names:
        if name not in ABLATIONS:
            raise SettingsError(f"--steps {name}: expected some of {', '.join(ABLATIONS)}")
    wanted = names or [name for name, ablation in ABLATIONS.items() if not ablation.is_slow]
    return [DEFAULT, *(name for name in dict.fromkeys(wanted) if name != DEFAULT)]
