"""Every shape and type in the library's annotations is checked while the tests run.

Numba's loops stay out of it: they are compiled from their own source and cannot be wrapped. By name: files that end in
``kernel`` or ``kernels``, and ``jit``.
"""

import pkgutil

import torch
from jaxtyping import install_import_hook

import wildpuppet
from tests import typecheck

torch.set_num_threads(1)  # two threads on a busy machine slow torch's small operations many times over

COMPILED = ("jit", "kernel", "kernels")
APPLICATION = ("wildpuppet.pipelines", "wildpuppet.configs")


def checked_modules() -> list[str]:
    """Every module of the library except compiled loops and the application."""
    names = [found.name for found in pkgutil.walk_packages(wildpuppet.__path__, "wildpuppet.") if not found.ispkg]
    return [name for name in names if not name.endswith(COMPILED) and not name.startswith(APPLICATION)]


install_import_hook(checked_modules(), f"{typecheck.__name__}.checked")
