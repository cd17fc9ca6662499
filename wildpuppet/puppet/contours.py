"""Rings around a silhouette, a margin outside it, with few corners: what a part's mesh is made of."""

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage
from skimage.measure import approximate_polygon, find_contours

Ring = Float[np.ndarray, "_ 2"]


def rings_around(mask: Bool[np.ndarray, "H W"], *, margin: float, tolerance: float, least_hole: float) -> list[Ring]:
    """Trace the silhouette grown by ``margin`` and simplify, never coming closer to it than ``margin``.

    Coordinates are the mask's, corner origin, and may be negative (the margin reaches outside). Corners lie at most
    about twice ``tolerance`` farther out than asked. Holes whose area after growing is below ``least_hole`` are closed.
    The last point of a ring is not a repeat of its first.
    """
    pad = int(np.ceil(margin + tolerance)) + 4
    outside = ~np.pad(mask, pad, constant_values=False)
    # not OpenCV's distance transform: its last bits differ from call to call, and meshes must not
    smooth = ndimage.gaussian_filter(ndimage.distance_transform_edt(outside), 1.0)
    raw = find_contours(smooth, margin + tolerance + 0.5)  # type: ignore[no-untyped-call]
    loops = [contour[:, ::-1] + 0.5 - pad for contour in raw if len(contour) >= 4]
    areas = np.array([_area(loop[:-1]) for loop in loops])
    outer = np.sign(areas[np.abs(areas).argmax()])
    kept = [loop for loop, area in zip(loops, areas, strict=True) if area * outer > 0.0 or abs(area) >= least_hole]
    return [simplify(loop, tolerance) for loop in kept]


def simplify(loop: Ring, tolerance: float) -> Ring:
    """Drop points of a closed loop (last point = first) as long as the rest stays within ``tolerance`` and simple.

    Where the simplified ring would cross itself or have fewer than four corners, the tolerance is halved until not.
    """
    start = int(np.linalg.norm(loop - loop.mean(axis=0), axis=1).argmax())
    loop = np.roll(loop[:-1], -start, axis=0)
    closed = np.concatenate([loop, loop[:1]])
    while tolerance > 0.05:
        ring = approximate_polygon(closed, tolerance)[:-1]  # type: ignore[no-untyped-call]
        if len(ring) >= 4 and not crosses_itself(ring):
            return np.asarray(ring, np.float64)
        tolerance *= 0.5
    return loop


def crosses_itself(ring: Ring) -> bool:
    """Tell whether two sides of a ring that are not neighbours cross."""
    a, b = ring, np.roll(ring, -1, axis=0)
    n = len(ring)
    side_a = _side(a[:, None], b[:, None], a[None]) * _side(a[:, None], b[:, None], b[None])
    crosses = (side_a < 0.0) & (side_a.T < 0.0)
    gap = (np.arange(n)[:, None] - np.arange(n)[None]) % n
    return bool((crosses & (gap > 1) & (gap < n - 1)).any())


def _side(
    start: Float[np.ndarray, "*s 2"], end: Float[np.ndarray, "*e 2"], point: Float[np.ndarray, "*p 2"]
) -> Float[np.ndarray, "*o"]:
    along, to = end - start, point - start
    side: Float[np.ndarray, "*o"] = along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]
    return side


def _area(ring: Ring) -> float:
    x, y = ring.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
