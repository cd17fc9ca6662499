"""A puppet without an author: from one frame and one box, a body with limbs that a person can correct.

The silhouette comes from ``foreground``, the cuts from its medial axis. Limbs that lie in front of the body do not show
in a silhouette and stay part of it. At every cut both parts cover the same disc, so that bending opens no gap: the body
goes on under the limb's root and the limb goes on into the body.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy import ndimage

from wildpuppet.errors import InputError
from wildpuppet.puppet.complete import complete_colour, grow
from wildpuppet.puppet.foreground import silhouette_in
from wildpuppet.puppet.limbs import find_cuts, label_nodes, label_pixels
from wildpuppet.puppet.naming import part_names
from wildpuppet.puppet.silhouette import silhouette_of
from wildpuppet.puppet.skeleton import Skeleton, skeleton_of
from wildpuppet.settings import AutoSettings
from wildpuppet.types import CutOut, JointSpec, Part

WORKING_PIXELS = 256
"""Larger side of the silhouette when it is cut into limbs."""
OVERLAP = 1.3
"""Radius of the disc that both parts cover at a cut, in radii of the silhouette there."""
SEAM_PIXELS = 3
"""Frame pixels by which parts overlap along the rest of their common border."""

INSET = 2
"""Pixels at a part's visible edge that lend no colour to what is hidden: they are mixed with what lies beside."""

Place = tuple[float, float]
Mask = Bool[np.ndarray, "H W"]


def automatic(
    rgb: UInt8[np.ndarray, "H W 3"],
    matte: UInt8[np.ndarray, "H W"] | None,
    box: tuple[float, float, float, float],
    settings: AutoSettings,
) -> CutOut:
    """Make a puppet from one frame: the canvas is the frame, parts are listed body first, then limbs outwards.

    ``box`` is x, y, w, h in pixels; ``matte`` is 255 where the character surely is, 0 where it surely is not and 128
    where nothing is known, or None.

    Raises:
        InputError: the box has no area inside the frame.
    """
    height, width = rgb.shape[:2]
    x, y, w, h = box
    if not (min(x + w, width) - max(x, 0.0) >= 4.0 and min(y + h, height) - max(y, 0.0) >= 4.0):
        raise InputError(f"box {x:g},{y:g},{w:g},{h:g}: less than 4 pixels of it lie in the {width} x {height} frame")
    alpha = silhouette_in(rgb, matte, box, settings.seed)
    labels, skeleton, cuts, to_frame = _limbs(alpha, settings)
    owners = _owners(labels, to_frame, alpha)
    masks = _part_masks(owners, skeleton, cuts, to_frame)
    owner = label_nodes(skeleton, cuts)
    parents = [int(owner[skeleton.parent[node]]) for node in cuts]
    names = part_names(skeleton, cuts, parents)
    parts = tuple(Part(name, _cut_out(rgb, alpha, masks[part], owners > part)) for part, name in enumerate(names))
    joints = tuple(
        JointSpec((names[parents[index]], names[index + 1]), _to_frame(skeleton.points[node], to_frame))
        for index, node in enumerate(cuts)
    )
    return CutOut((width, height), parts, joints)


def _limbs(
    alpha: UInt8[np.ndarray, "H W"], settings: AutoSettings
) -> tuple[Int[np.ndarray, "h w"], Skeleton, list[int], tuple[float, float, float]]:
    """Cut the silhouette at working scale; returns labels, axis, cuts and the frame's scale and corner (x, y)."""
    rows, columns = np.flatnonzero((alpha >= 128).any(axis=1)), np.flatnonzero((alpha >= 128).any(axis=0))
    top, left = int(rows[0]), int(columns[0])
    cut = alpha[top : int(rows[-1]) + 1, left : int(columns[-1]) + 1]
    scale = min(1.0, WORKING_PIXELS / max(cut.shape))
    size = max(1, round(cut.shape[1] * scale)), max(1, round(cut.shape[0] * scale))
    small = cv2.resize(cut, size, interpolation=cv2.INTER_AREA)
    area = silhouette_of(small, least_alpha=128, pinhole=0.0, speck=0.0, bridge=float(sum(size)))
    mask = np.ones((1, 1), bool) if area is None else area.mask
    skeleton = skeleton_of(mask, settings.seed)
    cuts = find_cuts(skeleton, settings.least_limb * max(mask.shape), settings.most_parts - 1)
    labels = label_pixels(mask, skeleton, label_nodes(skeleton, cuts))
    shift = (0, 0) if area is None else area.origin
    return labels, skeleton, cuts, (1.0 / scale, left + shift[0] / scale, top + shift[1] / scale)


def _to_frame(point: Float[np.ndarray, "2"], to_frame: tuple[float, float, float]) -> Place:
    scale, left, top = to_frame
    return float(point[0] * scale + left), float(point[1] * scale + top)


def _owners(
    labels: Int[np.ndarray, "h w"], to_frame: tuple[float, float, float], alpha: UInt8[np.ndarray, "H W"]
) -> Int[np.ndarray, "H W"]:
    """Enlarge the labels to the frame: the part of every pixel of the silhouette, -1 elsewhere."""
    scale, left, top = to_frame
    height, width = alpha.shape
    _, (rows, columns) = ndimage.distance_transform_edt(labels < 0, return_indices=True)
    spread = labels[rows, columns]
    across = np.clip((np.arange(width) + 0.5 - left) / scale, 0, labels.shape[1] - 1).astype(int)
    down = np.clip((np.arange(height) + 0.5 - top) / scale, 0, labels.shape[0] - 1).astype(int)
    return np.where(alpha > 0, spread[down[:, None], across[None]], -1)


def _part_masks(
    owners: Int[np.ndarray, "H W"], skeleton: Skeleton, cuts: list[int], to_frame: tuple[float, float, float]
) -> list[Mask]:
    """Let neighbours overlap: a little everywhere, a whole disc at the joints."""
    height, width = owners.shape
    masks: list[Mask] = [grow(owners == part, SEAM_PIXELS) & (owners >= 0) for part in range(len(cuts) + 1)]
    begun_at = label_nodes(skeleton, cuts)
    for index, node in enumerate(cuts):
        x, y = _to_frame(skeleton.points[node], to_frame)
        reach = OVERLAP * skeleton.radius[node] * to_frame[0] + SEAM_PIXELS
        disc = np.hypot(np.arange(width) + 0.5 - x, (np.arange(height) + 0.5 - y)[:, None]) <= reach
        for part in (index + 1, int(begun_at[skeleton.parent[node]])):
            masks[part] |= disc & (owners >= 0)
    return masks


def _cut_out(
    rgb: UInt8[np.ndarray, "H W 3"], alpha: UInt8[np.ndarray, "H W"], mask: Mask, is_hidden: Mask
) -> UInt8[np.ndarray, "H W 4"]:
    """Cut a part out of the frame; what parts in front of it hide gets the colours around, not a picture of them."""
    trust = np.where(is_hidden, 0.0, 1.0)
    has_own = bool((mask & ~is_hidden).any())
    trust[~mask] = 0.0
    color = complete_colour(rgb, trust, mask, inset=INSET) if has_own else rgb
    return np.dstack([color, np.where(mask, alpha, 0)]).astype(np.uint8)
