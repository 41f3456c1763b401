"""Simulation engines with a common interface, which is hexakin's own.

The Python package of an engine is imported only when its class is requested.
"""

from __future__ import annotations

import importlib
import importlib.util

from hexakin.checks import checked
from hexakin.engines.base import Engine, Reading, TorqueLaw
from hexakin.exceptions import UnknownNameError

ENGINES = {
    "mujoco": ("hexakin.engines.mujoco_engine", "MujocoEngine"),
    "pybullet": ("hexakin.engines.pybullet_engine", "PyBulletEngine"),
    "rigid": ("hexakin.engines.rigid_engine", "RigidEngine"),
}
"""The engines by name: (module, class) of each."""

__all__ = ["ENGINES", "Engine", "Reading", "TorqueLaw", "default_engine", "engine_class"]


def default_engine() -> str:
    """Return the name of the engine that is used where none is named: "pybullet" if PyBullet is installed, or "rigid".

    PyBullet has no wheels for some versions of Python and some platforms; hexakin's own engine runs on all of them.
    """
    return "rigid" if importlib.util.find_spec("pybullet") is None else "pybullet"


@checked
def engine_class(name: str) -> type[Engine]:
    """Return the class of the engine called ``name``.

    Raises UnknownNameError for an unknown name, and MissingPackageError if the engine's package is not installed.
    """
    if not isinstance(name, str) or name not in ENGINES:
        raise UnknownNameError("engine", name, sorted(ENGINES))
    module, attribute = ENGINES[name]
    return getattr(importlib.import_module(module), attribute)
