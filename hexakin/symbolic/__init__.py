"""The derivation of a leg's kinematics with sympy, and the numeric code written from it.

``python -m hexakin.symbolic`` writes the code of the shipped robots into ``hexakin.generated``.
"""

from hexakin.symbolic.leg import InverseExpressions, LegKinematics, derive, with_functions

__all__ = ["InverseExpressions", "LegKinematics", "derive", "with_functions"]
