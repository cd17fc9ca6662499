"""The one place where Numba is set up for the renderer's kernels.

``kernel`` compiles on first use, keeps the machine code on disk, and lets other Python threads run.
Superword vectorisation turns the four colour channels into one vector operation; Numba leaves it off by default.

Numba checks kept code against the source file of the kernel alone, but our kernels inline one another across files: a
change in one would leave the others stale. So code is kept in a folder named by the digest of all kernel sources.
"""

import hashlib
import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numba

Kernel = Callable[..., Any]

config: Any = numba.config
config.SLP_VECTORIZE = 1


def kernel(function: Kernel) -> Kernel:
    """Compile; the sign of zero does not count.

    Sums are not reassociated, nor products fused: code that was just compiled then rounds otherwise than the same code
    read from the disk, and a run that was killed and run again would differ from an unbroken one.
    """
    return _compile(function, fastmath={"nsz"})


def exact_kernel(function: Kernel) -> Kernel:
    """Compile with every operation rounded as written, so that two triangles agree on the edge they share."""
    return _compile(function, fastmath=False)


def _compile(function: Kernel, **options: Any) -> Kernel:
    """Make a dispatcher whose machine code is kept in our folder.

    The function is taken out of any wrapper first: tests check annotations by wrapping every function of a module.
    """
    chosen = config.CACHE_DIR
    config.CACHE_DIR = _cache_folder(chosen)
    compiled = cast(
        Kernel, numba.njit(cache=True, nogil=True, error_model="numpy", **options)(inspect.unwrap(function))
    )
    config.CACHE_DIR = chosen
    return compiled


def _cache_folder(chosen: str) -> str:
    """Name the folder: under NUMBA_CACHE_DIR where set, else beside the source, else in the user's cache."""
    here = Path(__file__).parent
    beside = here / "__pycache__" if os.access(here, os.W_OK) else Path.home() / ".cache" / "wildpuppet"
    return str((Path(chosen) if chosen else beside) / f"kernels-{_digest(here)}")


def _digest(folder: Path) -> str:
    """Digest every kernel source."""
    sources = [Path(__file__), *sorted(folder.glob("*kernel*.py"))]
    return hashlib.blake2b(b"".join(path.read_bytes() for path in sources), digest_size=8).hexdigest()
