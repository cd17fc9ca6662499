"""wildpuppet: layered puppets from cartoon clips (Neural Puppet, WACV 2020, carried to a product).

``run``, ``fit_drawings`` and ``open_run`` are imported when they are first used, so that ``import wildpuppet``
and ``--help`` cost nothing.
"""

import importlib
from typing import Any

_LAZY = {
    "run": ("wildpuppet.pipelines.run", "run"),
    "fit_drawings": ("wildpuppet.pipelines.fit", "fit"),
    "train": ("wildpuppet.pipelines.train", "train"),
    "load_model": ("wildpuppet.models", "load_model"),
    "open_run": ("wildpuppet.api", "open_run"),
    "Run": ("wildpuppet.api", "Run"),
    "WildPuppetError": ("wildpuppet.errors", "WildPuppetError"),
}

__all__ = ["Run", "WildPuppetError", "fit_drawings", "load_model", "open_run", "run", "train"]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'wildpuppet' has no attribute {name!r}")
    module, attribute = _LAZY[name]
    return getattr(importlib.import_module(module), attribute)
