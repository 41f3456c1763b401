"""Simulation engines behind one interface; an engine's package is imported when the engine is made."""

from __future__ import annotations

import importlib

from hexakin.engines.base import Engine, Reading, TorqueLaw
from hexakin.exceptions import UnknownNameError

ENGINES = {
    "pybullet": ("hexakin.engines.pybullet_engine", "PyBulletEngine"),
    "rigid": ("hexakin.engines.rigid_engine", "RigidEngine"),
}
"""Name -> (module, class)."""

__all__ = ["ENGINES", "Engine", "Reading", "TorqueLaw", "engine_class"]


def engine_class(name: str) -> type[Engine]:
    """Return the engine of this name; raises UnknownNameError, or MissingPackageError if its package is missing."""
    if not isinstance(name, str) or name not in ENGINES:
        raise UnknownNameError("engine", name, sorted(ENGINES))
    module, attribute = ENGINES[name]
    return getattr(importlib.import_module(module), attribute)
