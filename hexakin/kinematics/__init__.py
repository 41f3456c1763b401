"""Forward and inverse kinematics and Jacobians of all legs, broadcasting over leading axes."""

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
