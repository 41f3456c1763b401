"""The numeric functions of a leg type, prepared or derived when first used, and what follows from them alone."""

from __future__ import annotations

import importlib
from functools import lru_cache
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from hexakin.exceptions import NoClosedFormError
from hexakin.generated import MODULES
from hexakin.robot import LegTable, Robot
from hexakin.transforms import Array


@lru_cache(maxsize=64)
def leg_functions(table: LegTable) -> ModuleType | SimpleNamespace:
    """Return ``forward``, ``jacobian`` and ``inverse`` of a leg type: prepared ones if there are, else derived now.

    Without a closed-form inverse ``inverse`` raises NoClosedFormError when it is called.
    """
    module = MODULES.get(table.type_key)
    if module is not None:
        return importlib.import_module(f"hexakin.generated.{module}")
    from hexakin.symbolic import generate

    namespace: dict[str, Any] = {}
    exec(compile(generate(table), f"<leg type {table.type_key}>", "exec"), namespace)  # our own generated source
    return SimpleNamespace(**{name: namespace[name] for name in ("forward", "jacobian", "inverse")})


@lru_cache(maxsize=64)
def closed_form(table: LegTable) -> bool:
    """Whether the inverse of a leg type is known in closed form."""
    try:
        with np.errstate(all="ignore"):
            leg_functions(table).inverse(np.ones((1, len(table.parameters))), np.ones((1, 3)), 1, 1)
    except NoClosedFormError:
        return False
    return True


def reach(robot: Robot, *, limited: bool = False) -> Array:
    """Least and largest distance (L, 2) [m] of each foot from its leg's second joint.

    With ``limited`` within the joint limits. It depends on the third angle alone, and its square on that angle's
    sine and cosine: three values fix it.
    """
    q = np.zeros((3, robot.num_legs, 3))
    q[..., 2] = np.array([[0.0], [0.5], [1.0]]) * np.pi
    poses = np.array([robot.fixed_poses(leg) for leg in range(robot.num_legs)])
    second = (poses[:, 0] @ poses[:, 1])[:, :3, 3]
    feet = leg_functions(robot.table).forward(robot.parameters, q)
    at_0, at_90, at_180 = ((feet - second) ** 2).sum(axis=-1)
    mean, cosine = 0.5 * (at_0 + at_180), 0.5 * (at_0 - at_180)
    sine = at_90 - mean
    bounds = np.empty((robot.num_legs, 2))
    for leg in range(robot.num_legs):
        low, high = robot.joint_limits[leg, 2] if limited else (-np.pi, np.pi)
        extreme = np.arctan2(sine[leg], cosine[leg]) + np.pi * np.arange(-6, 7)
        angles = np.array([low, high, *extreme[(extreme >= low) & (extreme <= high)]])
        squares = mean[leg] + cosine[leg] * np.cos(angles) + sine[leg] * np.sin(angles)
        bounds[leg] = np.sqrt(np.maximum([squares.min(), squares.max()], 0.0))
    return bounds
