"""Feasibility before the robot moves: checks of a motion, contact forces that hold it, design questions (CasADi)."""

from hexakin.feasibility.checks import Constraint, FeasibilityReport, check
from hexakin.feasibility.design import Design, best_posture, highest_step, longest_stride, steepest_slope
from hexakin.feasibility.forces import ForceDistribution, distribute
from hexakin.feasibility.torques import forces_from_torques, internal_forces, torques_from_forces
from hexakin.motion.motion import Motion
from hexakin.simulation.commanded_walk import commanded_walk

__all__ = [
    "Constraint", "Design", "FeasibilityReport", "ForceDistribution", "Motion", "best_posture", "check",
    "commanded_walk", "distribute", "forces_from_torques", "highest_step", "internal_forces", "longest_stride",
    "steepest_slope", "torques_from_forces",
]  # fmt: skip
