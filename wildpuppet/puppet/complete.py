"""Fill in what a drawing hides: colour under the parts in front and beyond a part's edge.

Where something in front hides a part, its colour is the membrane stretched over the hole from the part's own visible
pixels (Laplace's equation, solved within the part's outline); outside the outline the nearest colour runs on.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array, identity
from scipy.sparse.csgraph import laplacian
from scipy.sparse.linalg import cg


def complete_colour(
    image: UInt8[np.ndarray, "H W 3"],
    trust: Float[np.ndarray, "H W"],
    is_wanted: Bool[np.ndarray, "H W"],
    *,
    inset: int = 0,
) -> UInt8[np.ndarray, "H W 3"]:
    """Keep the trusted pixels (1), replace the others (0) by a smooth fill that meets the trusted colours; mix between.

    The fill is the membrane that solves Laplace's equation inside the wanted pixels: colour spreads within the part
    and never across a gap. Trusted pixels within ``inset`` of the others are kept but lend no colour (edges are
    polluted by what lies beside them), unless none are left without them. What is not wanted comes back as it was.
    Raises ValueError where no pixel is trusted.
    """
    if not (trust >= 1).any():
        raise ValueError("complete_colour needs at least one trusted pixel")
    is_source = ~grow(trust < 1, inset)
    if not is_source.any():
        is_source = trust >= 1
    rows, columns = np.nonzero(is_wanted | is_source)
    window = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    share = np.where(is_wanted, trust, 1.0)[window][..., None]
    fill = _membrane(image[window], is_source[window], is_wanted[window])
    completed = image.copy()
    completed[window] = np.rint(share * image[window] + (1 - share) * fill)
    return completed


def bleed_colour(
    image: UInt8[np.ndarray, "H W 3"], is_inside: Bool[np.ndarray, "H W"], pixels: int
) -> UInt8[np.ndarray, "H W 3"]:
    """Run the inside's nearest colour on over the next ``pixels`` outside; what lies beyond is 0."""
    rows, columns = np.nonzero(grow(is_inside, pixels))
    nearest_rows, nearest_columns = distance_transform_edt(~is_inside, return_distances=False, return_indices=True)
    bled = np.zeros_like(image)
    bled[rows, columns] = image[nearest_rows[rows, columns], nearest_columns[rows, columns]]
    return bled


def grow(mask: Bool[np.ndarray, "H W"], pixels: int) -> Bool[np.ndarray, "H W"]:
    """Grow a mask by a disc of that radius; 0 leaves it as it is."""
    if pixels <= 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * pixels + 1, 2 * pixels + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), disc), dtype=bool)


def _membrane(
    image: UInt8[np.ndarray, "H W 3"], is_source: Bool[np.ndarray, "H W"], is_wanted: Bool[np.ndarray, "H W"]
) -> Float[np.ndarray, "H W 3"]:
    """Solve Laplace's equation over the wanted pixels with the sources held; the outline's edge reflects."""
    nearest = distance_transform_edt(~is_source, return_distances=False, return_indices=True)
    fill: Float[np.ndarray, "H W 3"] = image[tuple(nearest)].astype(np.float64)
    is_active = is_wanted | is_source
    is_unknown = ~is_source[is_active]
    if not is_unknown.any():
        return fill
    colours = fill[is_active]
    rows = _laplacian(is_active)[is_unknown]
    # A weak pull to the nearest colour determines pieces of the part that touch no source.
    system = rows[:, is_unknown] + 1e-6 * identity(int(is_unknown.sum()))
    held = 1e-6 * colours[is_unknown] - rows[:, ~is_unknown] @ colours[~is_unknown]
    for channel in range(3):
        start = colours[is_unknown, channel]
        colours[is_unknown, channel] = cg(system, held[:, channel], x0=start, rtol=1e-5)[0]
    fill[is_active] = np.clip(colours, 0.0, 255.0)
    return fill


def _laplacian(is_active: Bool[np.ndarray, "H W"]) -> csr_array:
    """Build the graph Laplacian of the active pixels, each tied to its active neighbours above, below and beside."""
    count = int(is_active.sum())
    number = np.full(is_active.shape, -1)
    number[is_active] = np.arange(count)
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    first, second = (np.concatenate([pair[side].ravel() for pair in pairs]) for side in (0, 1))
    is_tied = (first >= 0) & (second >= 0)
    ties = csr_array((np.ones(int(is_tied.sum())), (first[is_tied], second[is_tied])), (count, count))
    return csr_array(laplacian(ties + ties.T))
