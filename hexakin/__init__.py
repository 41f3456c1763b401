"""Analytical models of hexapod walking robots: kinematics, gaits, posture control, simulation, stability.

Everything is loaded when it is first used, so that importing hexakin costs next to nothing::

    import hexakin as hk
    robot = hk.load_robot("athena")
    p_body_foot = hk.forward_kinematics(robot, q)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from hexakin.installation import __version__

_NAMES = {
    "load_robot": "robot_file",
    "Robot": "robot",
    "forward_kinematics": "kinematics",
    "inverse_kinematics": "kinematics",
    "jacobian": "kinematics",
    "PostureController": "posture",
    "simulate": "simulation",
    "plan_walk": "walker",
    "WalkPlan": "walker",
    "Recording": "recording",
    "load_recording": "recording",
}
_MODULES = (
    "animation", "contact", "dynamics", "engines", "exceptions", "experiments", "feasibility", "figures", "gait",
    "kinematics", "measures", "paper", "posture", "rising", "sliders", "stability", "stance", "steering", "studies",
    "study", "support_region", "swing", "symbolic", "terrain", "transforms", "urdf", "walker",
)  # fmt: skip

if TYPE_CHECKING:
    from hexakin import (
        animation,
        contact,
        dynamics,
        engines,
        exceptions,
        experiments,
        feasibility,
        figures,
        gait,
        kinematics,
        measures,
        paper,
        posture,
        rising,
        sliders,
        stability,
        stance,
        steering,
        studies,
        study,
        support_region,
        swing,
        symbolic,
        terrain,
        transforms,
        urdf,
        walker,
    )
    from hexakin.kinematics import forward_kinematics, inverse_kinematics, jacobian
    from hexakin.posture import PostureController
    from hexakin.recording import Recording, load_recording
    from hexakin.robot import Robot
    from hexakin.robot_file import load_robot
    from hexakin.simulation import simulate
    from hexakin.walker import WalkPlan, plan_walk

__all__ = [*_NAMES, *_MODULES]


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        value = getattr(importlib.import_module(f"hexakin.{_NAMES[name]}"), name)
    elif name in _MODULES:
        value = importlib.import_module(f"hexakin.{name}")
    else:
        raise AttributeError(f"module 'hexakin' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
