"""One fixed colour per layer, told apart by colour-blind eyes too (Okabe and Ito 2008, then Tol's muted scheme)."""

PALETTE = (
    (230, 159, 0),
    (86, 180, 233),
    (0, 158, 115),
    (240, 228, 66),
    (213, 94, 0),
    (204, 121, 167),
    (0, 114, 178),
    (153, 153, 51),
    (204, 102, 119),
    (68, 170, 153),
    (170, 68, 153),
    (221, 204, 119),
)
"""RGB. Neighbours in the list differ in hue and lightness, since neighbouring layers often overlap."""


def colour_of(layer: int) -> tuple[int, int, int]:
    """Colour of a layer; puppets with more layers than colours begin again."""
    return PALETTE[layer % len(PALETTE)]


STATE_COLOURS = {"fitted": (0, 158, 115), "held": (86, 180, 233), "doubtful": (240, 228, 66), "lost": (213, 94, 0)}
"""RGB of each fit state, on dark grey."""
