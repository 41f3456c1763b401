"""Analytical models of hexapod walking robots: kinematics, gaits, posture control, simulation, stability.

Each module is loaded when it is first used, so ``import hexakin`` itself is fast::

    import hexakin as hk
    robot = hk.load_robot("athena")
    p_body_foot = hk.forward_kinematics(robot, q)
"""

from __future__ import annotations

import importlib
from typing import Any

from hexakin.installation import __version__

PUBLIC = {
    "Robot": "hexakin.robot.model:Robot",
    "load_robot": "hexakin.robot.file:load_robot",
    "forward_kinematics": "hexakin.kinematics.forward:forward_kinematics",
    "inverse_kinematics": "hexakin.kinematics.inverse:inverse_kinematics",
    "jacobian": "hexakin.kinematics.forward:jacobian",
    "Command": "hexakin.control.interface:Command",
    "ControlRun": "hexakin.control.interface:ControlRun",
    "Controller": "hexakin.control.interface:Controller",
    "Observation": "hexakin.control.interface:Observation",
    "PostureController": "hexakin.control.posture:PostureController",
    "simulate": "hexakin.simulation.closed_loop:simulate",
    "plan_walk": "hexakin.walking.planner:plan_walk",
    "WalkPlan": "hexakin.motion.walk_plan:WalkPlan",
    "Recording": "hexakin.motion.recording:Recording",
    "load_recording": "hexakin.motion.recording:load_recording",
    "animation": "hexakin.animation",
    "clearance": "hexakin.motion.clearance",
    "contact": "hexakin.contact",
    "dynamics": "hexakin.dynamics",
    "engines": "hexakin.engines",
    "exceptions": "hexakin.exceptions",
    "experiments": "hexakin.papers.scenarios",
    "feasibility": "hexakin.feasibility",
    "figures": "hexakin.figures",
    "gait": "hexakin.walking.gait",
    "kinematics": "hexakin.kinematics",
    "measures": "hexakin.motion.measures",
    "mjcf": "hexakin.robot.mjcf",
    "paper": "hexakin.papers.statements",
    "posture": "hexakin.control.posture",
    "rising": "hexakin.control.standing_up",
    "sliders": "hexakin.figures.sliders",
    "stability": "hexakin.stability",
    "stance": "hexakin.stability.stance",
    "steering": "hexakin.control.steering",
    "studies": "hexakin.papers.studies",
    "study": "hexakin.study",
    "support_region": "hexakin.stability.support_region",
    "swing": "hexakin.walking.swing",
    "symbolic": "hexakin.symbolic",
    "terrain": "hexakin.terrain",
    "transforms": "hexakin.transforms",
    "urdf": "hexakin.robot.urdf",
    "walker": "hexakin.walking.planner",
}
"""Each public name and what it stands for: a module, or ``module:name`` for an object of a module."""

__all__ = ["__version__", *PUBLIC]


def __getattr__(name: str) -> Any:
    if name not in PUBLIC:
        raise AttributeError(f"module 'hexakin' has no attribute {name!r}")
    module, _, attribute = PUBLIC[name].partition(":")
    value: Any = importlib.import_module(module)
    if attribute:
        value = getattr(value, attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
