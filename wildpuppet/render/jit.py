"""The one place where Numba is set up for the renderer's kernels.

``kernel`` compiles on first use, keeps the machine code beside the source, and lets other Python threads run.
Superword vectorisation turns the four colour channels into one vector operation; Numba leaves it off by default.
"""

from collections.abc import Callable
from typing import Any, cast

import numba

Kernel = Callable[..., Any]

setattr(numba.config, "SLP_VECTORIZE", 1)  # noqa: B010  (Numba declares it at run time: a plain assignment is a type error)


def kernel(function: Kernel) -> Kernel:
    """Compile; sums may be reassociated and fused (results differ in the last bits between machines)."""
    options: dict[str, Any] = {"fastmath": {"contract", "reassoc", "nsz", "arcp"}}
    return cast(Kernel, numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function))


def exact_kernel(function: Kernel) -> Kernel:
    """Compile with every operation rounded as written, so that two triangles agree on the edge they share."""
    return cast(Kernel, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
