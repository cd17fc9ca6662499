"""The Numba kernel of the fast ARAP energy; alone here, so that the shape checks of tests can leave it out."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def add_triangles(posed, triangles, inverses, areas, scales, energy, gradient):  # type: ignore[no-untyped-def]
    """Add each frame's energy and its gradient; see ``arap_energy_and_gradient``."""
    for frame in range(posed.shape[0]):
        target = 2 * scales[frame]
        for face in range(triangles.shape[0]):
            first, second, third = triangles[face, 0], triangles[face, 1], triangles[face, 2]
            x0, y0 = posed[frame, first, 0], posed[frame, first, 1]
            ux, uy = posed[frame, second, 0] - x0, posed[frame, second, 1] - y0
            vx, vy = posed[frame, third, 0] - x0, posed[frame, third, 1] - y0
            i00, i01, i10, i11 = inverses[face, 0, 0], inverses[face, 0, 1], inverses[face, 1, 0], inverses[face, 1, 1]
            j00, j01 = ux * i00 + vx * i10, ux * i01 + vx * i11
            j10, j11 = uy * i00 + vy * i10, uy * i01 + vy * i11
            turn_x, turn_y, shear_x, shear_y = j00 + j11, j10 - j01, j00 - j11, j10 + j01
            length = np.sqrt(turn_x * turn_x + turn_y * turn_y)
            area = areas[face]
            energy[frame] += area * ((length - target) ** 2 + shear_x * shear_x + shear_y * shear_y) / 2
            pull = area * (length - target) / length if length > 0 else 0 * area
            turn_x, turn_y, shear_x, shear_y = pull * turn_x, pull * turn_y, area * shear_x, area * shear_y
            g00, g01, g10, g11 = turn_x + shear_x, shear_y - turn_y, turn_y + shear_y, turn_x - shear_x
            dux, dvx = g00 * i00 + g01 * i01, g00 * i10 + g01 * i11
            duy, dvy = g10 * i00 + g11 * i01, g10 * i10 + g11 * i11
            gradient[frame, second, 0] += dux
            gradient[frame, second, 1] += duy
            gradient[frame, third, 0] += dvx
            gradient[frame, third, 1] += dvy
            gradient[frame, first, 0] -= dux + dvx
            gradient[frame, first, 1] -= duy + dvy
