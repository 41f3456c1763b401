"""Forward and inverse kinematics and Jacobians of all legs.

- ``forward``, ``inverse``: the public functions. They check their arguments.
- ``branches``: the branches of the inverse, and the choice among them.
- ``evaluation``: which of three numeric codes evaluates the formulas. ``bounds``: what the inverse compares with.
- ``leg_functions``, ``code_cache``: the numeric code of a leg type, and where that of unshipped leg types is kept.
- ``numerical``: the inverse of a leg without a closed form.
"""

from hexakin.kinematics.branches import BRANCH_SIGNS, InverseSolution, standing_branch
from hexakin.kinematics.evaluation import prepare
from hexakin.kinematics.forward import (
    contact_jacobian,
    forward_kinematics,
    jacobian,
    joint_axes,
    segment_poses,
    standing_height,
)
from hexakin.kinematics.inverse import (
    inverse_kinematics,
    path_inverse_kinematics,
    posed_inverse_kinematics,
    within_limits,
)

__all__ = [
    "BRANCH_SIGNS", "InverseSolution", "contact_jacobian", "forward_kinematics", "inverse_kinematics", "jacobian",
    "joint_axes", "path_inverse_kinematics", "posed_inverse_kinematics", "prepare", "segment_poses",
    "standing_branch", "standing_height", "within_limits",
]  # fmt: skip
