"""Checks of the arguments of public functions: their kinds by the annotations, their values by functions."""

from hexakin.checks.annotations import checked
from hexakin.checks.values import (
    Array,
    check_angle,
    check_array,
    check_arrays,
    check_columns,
    check_flags,
    check_function,
    check_number,
    check_path,
    check_poses,
    check_same_length,
    check_shape,
    check_whole,
    is_number,
    is_whole,
    read_only,
)

__all__ = [
    "Array",
    "check_angle",
    "check_array",
    "check_arrays",
    "check_columns",
    "check_flags",
    "check_function",
    "check_number",
    "check_path",
    "check_poses",
    "check_same_length",
    "check_shape",
    "check_whole",
    "checked",
    "is_number",
    "is_whole",
    "read_only",
]
