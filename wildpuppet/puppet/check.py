"""What is wrong with a cut-out puppet, in words: one sentence per finding, with what to do about it.

Findings are not errors: a puppet with findings still builds. What cannot be read at all is an error in ``folder``.
"""

from collections import Counter
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from wildpuppet.geometry.topology import smallest_angles
from wildpuppet.puppet.build import build, part_silhouette, rest_side
from wildpuppet.puppet.complete import grow
from wildpuppet.puppet.joints import joint_positions, nearest_middle
from wildpuppet.settings import PuppetSettings
from wildpuppet.types import CutOut, JointSpec, Part, Puppet

TINY_SHARE = 0.0003
"""A part with less than this share of the area of the square on the character's larger side is tiny."""
THIN_SHARE = 0.012
"""A part nowhere wider than this share of the character's larger side is a sliver."""
TOUCH_PIXELS = 2
"""Parts at most this far apart touch."""
POOR_ANGLE = 10.0
"""Mesh angles below this many degrees make the fit stiff there."""

_DEFAULTS = PuppetSettings()

Masks = dict[str, Bool[np.ndarray, "H W"]]


def check(cutout: CutOut, settings: PuppetSettings = _DEFAULTS) -> list[str]:
    """List what is wrong or doubtful with a puppet; an empty list is a sound puppet.

    Raises:
        PuppetError: a part has no pixel of at least ``settings.least_alpha``.
    """
    side = rest_side(cutout, settings.least_alpha)
    masks = {part.name: part.rgba[..., 3] >= settings.least_alpha for part in cutout.parts}
    findings = [finding for part in cutout.parts for finding in _part_findings(part, side, settings)]
    findings += _touch_findings(masks)
    findings += _joint_findings(cutout, masks, side, settings)
    findings += _graph_findings(cutout)
    findings += _mesh_findings(build(cutout, settings))
    return findings


def _part_findings(part: Part, side: float, settings: PuppetSettings) -> list[str]:
    name, alpha = part.name, part.rgba[..., 3]
    area = part_silhouette(part, side, settings)
    pixels = int(area.drawn.sum())
    width = 2.0 * float(ndimage.distance_transform_edt(np.pad(area.mask, 1)).max())
    findings = []
    if (alpha == 255).all():
        findings.append(f"part {name!r} covers the whole canvas without transparency; cut it out")
    elif alpha.max() < 128:
        findings.append(f"part {name!r} is nearly transparent (alpha at most {alpha.max()} of 255)")
    if pixels < TINY_SHARE * side**2:
        findings.append(f"part {name!r} is tiny ({pixels} pixels); join it to its neighbour or draw it larger")
    elif width < THIN_SHARE * side:
        findings.append(f"part {name!r} is a sliver (nowhere wider than {width:.0f} pixels); widen it")
    if area.num_holes:
        findings.append(f"part {name!r} has {area.num_holes} hole(s); fill them unless one sees through the part there")
    if area.num_specks:
        findings.append(f"part {name!r} has {area.num_specks} stray speck(s), which are left out; erase them")
    if area.num_pieces > 1:
        findings.append(f"part {name!r} is {area.num_pieces} separate pieces, which move apart; split it or join them")
    return findings


def _touch_findings(masks: Masks) -> list[str]:
    """Find parts that no other part touches."""
    if len(masks) < 2:
        return []
    alone = set(masks)
    grown = {name: grow(mask, TOUCH_PIXELS) for name, mask in masks.items()}
    for a, b in combinations(masks, 2):
        if (a in alone or b in alone) and (grown[a] & masks[b]).any():
            alone -= {a, b}
    return [f"part {name!r} touches no other part; draw it until it overlaps" for name in masks if name in alone]


def _joint_findings(cutout: CutOut, masks: Masks, side: float, settings: PuppetSettings) -> list[str]:
    findings = []
    for index, (joint, place) in enumerate(
        zip(cutout.joints, joint_positions(cutout, settings.least_alpha), strict=True)
    ):
        label = f"joint {index} ({joint.parts[0]!r} to {joint.parts[1]!r})"
        findings += _place_findings(label, joint, place, masks, settings.margin)
        a, b = (masks[name] for name in joint.parts)
        if not (a & b).any():
            _, gap = nearest_middle(a, b)
            what = f"are {gap:.0f} pixels apart" if gap > TOUCH_PIXELS else "touch but do not overlap"
            findings.append(f"{label}: its parts {what}; draw them over each other so that bending opens no gap")
    pairs = Counter(frozenset(joint.parts) for joint in cutout.joints)
    twice = [sorted(pair) for pair, count in pairs.items() if count > 1]
    return findings + [f"parts {a!r} and {b!r} have several joints, which makes them one stiff piece" for a, b in twice]


def _place_findings(
    label: str, joint: JointSpec, place: Float[np.ndarray, "2"], masks: Masks, margin: float
) -> list[str]:
    findings = []
    for name in joint.parts:
        rows, columns = np.nonzero(masks[name])
        distance = float(np.hypot(columns + 0.5 - place[0], rows + 0.5 - place[1]).min())
        if distance > margin and joint.at is not None:
            x, y = place
            findings.append(
                f"{label} at {x:.0f},{y:.0f} lies {distance:.0f} pixels outside {name!r}; move it inside both"
            )
    return findings


def _graph_findings(cutout: CutOut) -> list[str]:
    """Say whether the joints tie all parts together, and where they close a ring."""
    names = [part.name for part in cutout.parts]
    number = {name: index for index, name in enumerate(names)}
    pairs = {tuple(sorted(number[name] for name in joint.parts)) for joint in cutout.joints}
    ends = np.array(sorted(pairs), np.int64).reshape(-1, 2)
    graph = csr_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(names), len(names)))
    count, labels = connected_components(graph, directed=False)
    findings = []
    if count > 1:
        largest = int(np.bincount(labels).argmax())
        for group in (label for label in range(count) if label != largest):
            members = [repr(name) for name, label in zip(names, labels, strict=True) if label == group]
            findings.append(f"no joint ties {', '.join(members)} to the rest; add one")
    num_rings = len(ends) - len(names) + count
    if num_rings:
        findings.append(
            f"the joints close {num_rings} ring(s) of parts; this is allowed, but such parts move less freely"
        )
    return findings


def _mesh_findings(puppet: Puppet) -> list[str]:
    angles = smallest_angles(puppet.vertices, puppet.triangles)
    poor = np.bincount(puppet.layer_of_triangle[angles < POOR_ANGLE], minlength=puppet.num_layers)
    return [
        f"the mesh of part {name!r} has {count} thin triangle(s); smooth its outline's narrowest notch"
        for name, count in zip(puppet.names, poor, strict=True)
        if count
    ]
