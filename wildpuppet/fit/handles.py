"""Handles: points of the puppet that a person drags, and the energy that says what the rest should do.

Neural Puppet, section 3.5 (user-constrained deformation):

    L_deform = L_user + 25 L_reg + 50 L_joints,     L_user = sum_i |p_i(v) - target_i|^2

p_i is a mix of three vertices (barycentric coordinates), L_reg as-rigid-as-possible (``geometry/arap.py``), L_joints
the hinges' squared gaps. The weights balance with vertices in [-1, 1] along the crop's larger side. It can be lowered
over a decoder's codes (``fit/pull_codes.py``: ours and the paper's) or over the vertices (``fit/pull_vertices.py``: the
baseline).

A point x of the energy (X = 2 V numbers) is all vertices in a row, (x0, y0, x1, y1, ...), in those units and relative
to the crop's corner: nothing here depends on where the origin is.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from wildpuppet.geometry.arap import arap_rest
from wildpuppet.types import Puppet

RIGID = 25.0
JOINTS = 50.0
"""The paper's weights beside L_user's 1."""
LEAST_LENGTH = 1e-12


@dataclass(frozen=True, eq=False)
class Handles:
    """N dragged points: the mix ``weights[n]`` of the vertices ``corners[n]`` is to stand at ``targets[n]``.

    Targets are in the pixels of the vertices that are dragged.
    """

    corners: Int[np.ndarray, "N 3"]
    weights: Float[np.ndarray, "N 3"]
    targets: Float[np.ndarray, "N 2"]

    def points(self, vertices: Float[np.ndarray, "*B V 2"]) -> Float[np.ndarray, "*B N 2"]:
        """Find where the points are on posed vertices."""
        return np.asarray(np.einsum("...nkd,nk->...nd", vertices[..., self.corners, :], self.weights))

    def missing(self, vertices: Float[np.ndarray, "V 2"]) -> Float[np.ndarray, "N"]:
        """Measure how far each point is from its target, pixels."""
        return np.asarray(np.linalg.norm(self.points(vertices) - self.targets, axis=-1))

    def rows(self, num_vertices: int) -> sparse.csr_array:
        """Build the (N, V) matrix that takes a coordinate of the vertices to that of the points."""
        return mixes(self.corners, self.weights, num_vertices)


def mixes(corners: Int[np.ndarray, "N K"], weights: Float[np.ndarray, "N K"], num_vertices: int) -> sparse.csr_array:
    """Build the (N, V) matrix of weighted sums of vertices."""
    rows = np.repeat(np.arange(len(corners)), corners.shape[1])
    return sparse.csr_array((weights.reshape(-1), (rows, corners.reshape(-1))), shape=(len(corners), num_vertices))


@dataclass(frozen=True, eq=False)
class Rows:
    """Residuals whose sum of squares is the energy, and their derivative by x."""

    residual: Float[np.ndarray, "R"]
    jacobian: sparse.csr_array


@dataclass(frozen=True, eq=False)
class DeformEnergy:
    """L_deform of one pose; build with ``deform_energy``.

    ``turn`` and ``cross`` (F, 2V) give the part of each triangle's Jacobian that turns and scales, ``shear`` (2F, 2V)
    the part that shears (``geometry/arap.py`` calls them s and d), all of them times the square root of their weight,
    which is ``strength``. ``user`` (2N, 2V) and ``joints`` (2J, 2V) are weighted too. ``gaps`` are the hinges' of the
    undeformed shape (0 at rest). ``unit`` is the units per pixel.
    """

    turn: sparse.csr_array
    cross: sparse.csr_array
    shear: sparse.csr_array
    strength: Float[np.ndarray, "F"]
    user: sparse.csr_array
    targets: Float[np.ndarray, "M"]
    joints: sparse.csr_array
    gaps: Float[np.ndarray, "_"]
    mass: Float[np.ndarray, "X"]
    unit: float

    @cached_property
    def linear(self) -> sparse.csr_array:
        """The rows that do not change with x: handles, hinges, shear."""
        return sparse.csr_array(sparse.vstack([self.user, self.joints, self.shear]))

    @cached_property
    def wanted(self) -> Float[np.ndarray, "R"]:
        """What those rows ought to be."""
        return np.concatenate([self.targets, self.gaps, np.zeros(self.shear.shape[0])])

    def terms(self, x: Float[np.ndarray, "X"]) -> dict[str, float]:
        """Compute the weighted terms."""
        stretch = self._length(x) - 2.0 * self.strength
        return {
            "user": float(((self.user @ x - self.targets) ** 2).sum()),
            "rigid": float((stretch**2).sum() + ((self.shear @ x) ** 2).sum()),
            "joints": float(((self.joints @ x - self.gaps) ** 2).sum()),
        }

    def value(self, x: Float[np.ndarray, "X"]) -> float:
        """Compute L_deform."""
        return sum(self.terms(x).values())

    def rows(self, x: Float[np.ndarray, "X"]) -> Rows:
        """Linearise about x."""
        length, along, _ = self._turned(x)
        residual = np.concatenate([self.linear @ x - self.wanted, length - 2.0 * self.strength])
        return Rows(residual, sparse.csr_array(sparse.vstack([self.linear, along])))

    def gradient(self, x: Float[np.ndarray, "X"]) -> Float[np.ndarray, "X"]:
        """Compute the derivative of L_deform."""
        rows = self.rows(x)
        return np.asarray(2.0 * (rows.jacobian.T @ rows.residual))

    def tension(self, x: Float[np.ndarray, "X"]) -> sparse.csr_array:
        """Give the rows of the curvature that Gauss-Newton leaves out: of stretched triangles, by their turning.

        Squeezed triangles would curve the energy downwards; they give nothing, so that steps go down.
        """
        length, _, across = self._turned(x)
        share = np.sqrt(np.clip(1.0 - 2.0 * self.strength / length, 0.0, None))
        return sparse.csr_array(sparse.diags_array(share) @ across)

    def _length(self, x: Float[np.ndarray, "X"]) -> Float[np.ndarray, "F"]:
        return np.asarray(np.hypot(self.turn @ x, self.cross @ x))

    def _turned(self, x: Float[np.ndarray, "X"]) -> tuple[Float[np.ndarray, "F"], sparse.csr_array, sparse.csr_array]:
        """Length of each triangle's s, and the rows along it and across it."""
        turn, cross = self.turn @ x, self.cross @ x
        length = np.maximum(np.hypot(turn, cross), LEAST_LENGTH)
        cos, sin = sparse.diags_array(turn / length), sparse.diags_array(cross / length)
        return length, cos @ self.turn + sin @ self.cross, cos @ self.cross - sin @ self.turn


def deform_energy(
    puppet: Puppet, rest: Float[np.ndarray, "V 2"], handles: Handles, unit: float, rigid: float = RIGID
) -> DeformEnergy:
    """Prepare the energy. ``rest`` is the undeformed shape at the size at which it is seen, pixels as the targets.

    The paper's ``rest`` is the puppet at rest. With the pose that is dragged, hinges that stand open may stay so, and a
    handle that stays where it is moves nothing. ``unit`` is 2 over the crop's larger side.
    """
    count = len(puppet.vertices)
    shape = arap_rest(np.asarray(rest, np.float64) * unit, puppet.triangles)
    strength = np.sqrt(rigid * 0.5 * shape.areas)
    across, down = (_slopes(shape.inverses[:, :, k], puppet.triangles, count) for k in (0, 1))
    scale = sparse.diags_array(strength)
    shear = [_on(scale @ across, scale @ (-down)), _on(scale @ down, scale @ across)]
    joints = in_plane(np.sqrt(JOINTS) * joint_rows(puppet))
    lumped = np.bincount(puppet.triangles.reshape(-1), np.repeat(shape.areas / 3, 3), count)
    return DeformEnergy(
        turn=_on(scale @ across, scale @ down),
        cross=_on(scale @ (-down), scale @ across),
        shear=sparse.csr_array(sparse.vstack(shear)),
        strength=strength,
        user=in_plane(handles.rows(count)),
        targets=(handles.targets * unit).reshape(-1).astype(np.float64),
        joints=joints,
        gaps=np.asarray(joints @ (np.asarray(rest, np.float64).reshape(-1) * unit)),
        mass=np.repeat(lumped, 2),
        unit=unit,
    )


def joint_rows(puppet: Puppet) -> sparse.csr_array:
    """Build the (J, V) matrix of the hinges' gaps, one coordinate."""
    corners = puppet.joint_vertices.reshape(-1, 6)
    weights = (puppet.joint_weights.astype(np.float64) * np.array([1.0, -1.0])[None, :, None]).reshape(-1, 6)
    return mixes(corners, weights, len(puppet.vertices))


def in_plane(rows: sparse.csr_array) -> sparse.csr_array:
    """Apply rows to both coordinates of interleaved points."""
    return sparse.csr_array(sparse.kron(rows, sparse.eye_array(2)))


def _slopes(inverses: Float[np.ndarray, "F 2"], triangles: Int[np.ndarray, "F 3"], count: int) -> sparse.csr_array:
    """Build the (F, V) matrix of a coordinate's slope in each triangle along one axis of the rest shape."""
    weights = np.concatenate([-inverses.sum(1, keepdims=True), inverses], 1)
    return mixes(triangles, weights, count)


def _on(of_x: sparse.csr_array, of_y: sparse.csr_array) -> sparse.csr_array:
    """Add rows of the x coordinates and rows of the y coordinates."""
    x, y = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    return sparse.csr_array(sparse.kron(of_x, x) + sparse.kron(of_y, y))
