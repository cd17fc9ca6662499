"""Cut a puppet out of one drawing along outlines that a person drew: the paper's way of making a puppet.

A person outlines the parts on one frame, back to front; ``imports`` reads what the usual tools save. Each part becomes
an image of the canvas's size: alpha is the outline's exact coverage (a ramp of about one pixel), colour is the frame's
where nothing in front hides the part, and is **completed** from the part's own visible pixels everywhere else, so that
a limb that moves away uncovers its neighbour and not a picture of itself. Colour also runs on for a few pixels outside
the outline; no background can leak in when the part is resampled.

Neural Puppet (Poursaeed et al., WACV 2020), section 3.2. Outlines are in frame pixels, corner origin.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import distance_transform_edt

from wildpuppet.errors import PuppetError
from wildpuppet.puppet.complete import bleed_colour, complete_colour
from wildpuppet.puppet.coverage import Rule, rings_coverage
from wildpuppet.types import CutOut, JointSpec, Part


@dataclass(frozen=True, eq=False)
class Outline:
    """One part's polygon in frame pixels (corner origin), at least three points, either direction, not repeated.

    ``further`` are rings beside the first: other pieces and holes, told apart by ``rule``.
    """

    name: str
    points: Float[np.ndarray, "N 2"]
    further: tuple[Float[np.ndarray, "_ 2"], ...] = ()
    rule: Rule = "evenodd"

    def coverage(self, size: tuple[int, int]) -> Float[np.ndarray, "H W"]:
        """Measure which share of each pixel of the frame the part covers, 0..1."""
        return rings_coverage([self.points, *self.further], size, self.rule)


@dataclass(frozen=True, eq=False)
class Stencil:
    """One part as a mask that covers the frame, True where the part is."""

    name: str
    mask: Bool[np.ndarray, "H W"]

    def coverage(self, size: tuple[int, int]) -> Float[np.ndarray, "H W"]:
        """Give the mask as shares, 0 or 1."""
        if self.mask.shape != size[::-1]:
            height, width = self.mask.shape
            raise PuppetError(
                f"part {self.name!r}: its mask is {width}x{height}, the frame is {size[0]}x{size[1]}; "
                "use the frame it was drawn on"
            )
        return self.mask.astype(np.float64)


@dataclass(frozen=True, eq=False)
class Outlines:
    """What an outline file says: parts back to front, hinges, the frame's size and its number where known.

    ``halo`` is how many pixels beside a part in front are not believed to be a part's own colour; over as many more the
    frame's colour fades in, and the completion borrows from pixels that far from any edge. 0 for clean vector art, 1
    for clean video, 3 for compressed video with soft edges.
    """

    parts: tuple[Outline | Stencil, ...]
    joints: tuple[JointSpec, ...] = ()
    canvas: tuple[int, int] | None = None
    reference: int | None = None
    halo: int = 1


def cutout_from_outlines(frame_rgb: UInt8[np.ndarray, "H W 3"], outlines: Outlines, *, bleed: int = 6) -> CutOut:
    """Cut every outlined part out of the frame and complete what the parts in front hide.

    ``bleed`` is how many pixels the colour runs on outside a part's outline. Raises PuppetError where outlines
    contradict the frame or one another, or where a part shows no pixel of its own to complete it from.
    """
    height, width = frame_rgb.shape[:2]
    _check_outlines(outlines, (width, height))
    in_front = np.zeros((height, width), bool)
    parts: list[Part] = []
    for outline in reversed(outlines.parts):
        coverage = outline.coverage((width, height))
        trust = _trust(coverage >= 1, in_front, outlines.halo)
        if not (trust >= 1).any():
            raise PuppetError(
                f"part {outline.name!r} shows no pixel of its own: parts in front hide it or its outline has no "
                "inside; move it forwards in the order or draw it larger"
            )
        rgb = complete_colour(frame_rgb, trust, coverage >= 1, inset=outlines.halo)
        rgb = bleed_colour(rgb, coverage >= 1, bleed)
        parts.insert(0, Part(outline.name, np.dstack([rgb, np.rint(255 * coverage).astype(np.uint8)])))
        in_front |= coverage > 0
    return CutOut((width, height), tuple(parts), outlines.joints, outlines.reference)


def _check_outlines(outlines: Outlines, size: tuple[int, int]) -> None:
    if outlines.canvas is not None and outlines.canvas != size:
        raise PuppetError(
            f"the outlines were drawn on a {outlines.canvas[0]}x{outlines.canvas[1]} picture, the frame is "
            f"{size[0]}x{size[1]}; use the frame they were drawn on"
        )
    if not outlines.parts:
        raise PuppetError("expected at least one outlined part, found none; draw one polygon per part")
    names = [outline.name for outline in outlines.parts]
    for name in names:
        if names.count(name) > 1:
            raise PuppetError(f"two outlines are named {name!r}; give each part its own name")
    for outline in outlines.parts:
        if isinstance(outline, Outline):
            _check_points(outline, size)
    for joint in outlines.joints:
        unknown = [name for name in joint.parts if name not in names]
        if unknown or joint.parts[0] == joint.parts[1]:
            raise PuppetError(
                f"hinge {joint.parts[0]}+{joint.parts[1]} must name two different parts; "
                f"the parts are {', '.join(names)}"
            )


def _check_points(outline: Outline, size: tuple[int, int]) -> None:
    for ring in (outline.points, *outline.further):
        if len(ring) < 3:
            raise PuppetError(f"part {outline.name!r} has {len(ring)} points; an outline needs at least 3")
    points = np.concatenate([outline.points, *outline.further])
    if not np.isfinite(points).all():
        raise PuppetError(f"part {outline.name!r} has a point that is not a number; draw it again")
    if (points.max(0) <= 0).any() or (points.min(0) >= size).any():
        raise PuppetError(f"part {outline.name!r} lies wholly outside the {size[0]}x{size[1]} frame; move it inside")


def _trust(
    is_inside: Bool[np.ndarray, "H W"], in_front: Bool[np.ndarray, "H W"], halo: int
) -> Float[np.ndarray, "H W"]:
    """Say how far a pixel can be believed to show the part: 0 under and near the parts in front, 1 away from them."""
    distance = distance_transform_edt(~in_front) if in_front.any() else np.full(in_front.shape, np.inf)
    trust: Float[np.ndarray, "H W"] = np.clip((distance - halo) / max(halo, 1), 0, 1) * is_inside
    return trust
