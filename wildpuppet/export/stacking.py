"""Changes of the draw order for programs whose layers lie in a fixed stack.

A part that changes its place appears on several sheets of the stack, of which one is shown at a time. A change
uses the sheets that are there, where their places allow it, and new ones for the rest.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Int


@dataclass(eq=False)
class Sheet:
    """A part's place in the stack, and the spans of frames (end not included) in which it is shown there."""

    layer: int
    spans: list[tuple[int, int]] = field(default_factory=list)

    def shown(self, is_visible: Bool[np.ndarray, "T"]) -> Bool[np.ndarray, "T"]:
        """Tell for each frame whether the part is seen on this sheet; nowhere where the character is lost."""
        shown = np.zeros(len(is_visible), bool)
        for start, end in self.spans:
            shown[start:end] = is_visible[start:end]
        return shown


def sheets(order: Int[np.ndarray, "T L"]) -> list[Sheet]:
    """Stack the sheets, back to front, so that those shown in frame t are ``order[t]`` from back to front."""
    stack: list[Sheet] = []
    shown: dict[int, Sheet] = {}
    begun: dict[int, int] = {}
    for t, wanted in enumerate(order.tolist()):
        if t and order[t - 1].tolist() == wanted:
            continue
        chosen = _placed(stack, wanted, _kept(stack, shown, wanted))
        for layer in wanted:
            if layer in shown and shown[layer] is not chosen[layer]:
                shown[layer].spans.append((begun.pop(layer), t))
            begun.setdefault(layer, t)
        shown = chosen
    for layer, sheet in shown.items():
        sheet.spans.append((begun[layer], len(order)))
    return stack


def _kept(stack: list[Sheet], shown: dict[int, Sheet], wanted: list[int]) -> dict[int, Sheet]:
    """Choose sheets that are there, one per part at most, that lie in the wanted order: as many as possible.

    Among as many, those that are shown already. It is the heaviest rising chain of places; a part's own sheets are
    tried from the top down, so that no chain has two of them.
    """
    every = [place for layer in wanted for place in range(len(stack))[::-1] if stack[place].layer == layer]
    weights = [len(wanted) + 1 + (shown.get(stack[place].layer) is stack[place]) for place in every]
    heaviest, before = list(weights), [-1] * len(every)
    for k, place in enumerate(every):
        for j in range(k):
            if every[j] < place and heaviest[j] + weights[k] > heaviest[k]:
                heaviest[k], before[k] = heaviest[j] + weights[k], j
    kept = {}
    k = max(range(len(every)), key=heaviest.__getitem__, default=-1)
    while k >= 0:
        kept[stack[every[k]].layer] = stack[every[k]]
        k = before[k]
    return kept


def _placed(stack: list[Sheet], wanted: list[int], kept: dict[int, Sheet]) -> dict[int, Sheet]:
    """Give every part its sheet: the one that is kept, or a new one on top of the part behind it."""
    chosen: dict[int, Sheet] = {}
    place = -1
    for layer in wanted:
        sheet = kept.get(layer)
        if sheet is None:
            sheet = Sheet(layer)
            stack.insert(place + 1, sheet)
        place = stack.index(sheet)
        chosen[layer] = sheet
    return chosen
