"""What a robot can do, before it tries: checks of a motion, forces that hold it, and small design problems (CasADi)."""

from hexakin.feasibility.checks import Constraint, FeasibilityReport, check
from hexakin.feasibility.forces import ForceDistribution, distribute
from hexakin.feasibility.motion import Motion, commanded_walk

__all__ = ["Constraint", "FeasibilityReport", "ForceDistribution", "Motion", "check", "commanded_walk", "distribute"]
