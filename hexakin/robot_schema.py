"""The fields of a robot description, checked by pydantic; ``robot_file`` reads and builds with them."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from hexakin.robot import NUM_JOINTS, pi_multiple


def _angle(value: Any) -> Any:
    exact = pi_multiple(value) if isinstance(value, str) else None
    return value if exact is None else float(exact) * math.pi


def _entry(value: str | int) -> str | int:
    if isinstance(value, int) and value != 0:
        raise ValueError("a length or angle other than 0 needs a name; give its value under parameters")
    if isinstance(value, str) and pi_multiple(value) is None and not value.isidentifier():
        raise ValueError("expected 0, a multiple of pi such as pi/2, or a name")
    return value


_Number = Annotated[float, BeforeValidator(_angle), Field(allow_inf_nan=False, strict=True)]
_Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False, strict=True)]
_Vector = Annotated[list[_Number], Field(min_length=3, max_length=3)]
_PositiveVector = Annotated[list[_Positive], Field(min_length=3, max_length=3)]
_Limits = Annotated[list[_Number], Field(min_length=2, max_length=2)]
_Entry = Annotated[str | int, AfterValidator(_entry)]


class _Fields(BaseModel):
    """Unknown fields are errors: they are misspelt ones."""

    model_config = ConfigDict(extra="forbid")


class InertiaFields(_Fields):
    """Entries of the inertia tensor about the centre of mass [kg m^2]."""

    xx: _Positive
    yy: _Positive
    zz: _Positive
    xy: _Number = 0.0
    yz: _Number = 0.0
    xz: _Number = 0.0


class BodyFields(_Fields):
    """The torso or a segment."""

    mass: _Positive
    size: _PositiveVector
    inertia: InertiaFields
    center_of_mass: _Vector | None = None


class _FootFields(_Fields):
    """A spherical foot; radius 0 is a point foot, good for kinematics only."""

    mass: _Positive
    radius: Annotated[float, Field(ge=0.0, allow_inf_nan=False, strict=True)]
    inertia: InertiaFields


class _RowFields(_Fields):
    theta: _Entry
    d: _Entry
    a: _Entry
    alpha: _Entry


class _TableFields(_Fields):
    """The Denavit-Hartenberg table that all legs share."""

    convention: Literal["classical", "modified"]
    joints: Annotated[list[str], Field(min_length=NUM_JOINTS, max_length=NUM_JOINTS)]
    rows: Annotated[list[_RowFields], Field(min_length=NUM_JOINTS)]
    mount: Annotated[list[_Entry], Field(min_length=3, max_length=3)] | None = None
    parameters: dict[str, _Number] = {}


class _LegFields(_Fields):
    """What is a leg's own; its limits and standing angles override the file's."""

    name: str
    parameters: dict[str, _Number] = {}
    joint_limits: dict[str, _Limits] = {}
    standing: dict[str, _Number] = {}


class _ServoFields(_Fields):
    max_torque: _Positive
    rate: _Positive
    max_speed: _Positive | None = None


class _SegmentsFields(_Fields):
    coxa: BodyFields
    femur: BodyFields
    tibia: BodyFields


class RobotFields(_Fields):
    """A whole file."""

    name: str
    reference: str = ""
    num_legs: Annotated[int, Field(ge=1, strict=True)]
    forward: _Vector
    torso: BodyFields
    leg_table: _TableFields
    legs: list[_LegFields]
    segments: _SegmentsFields
    foot: _FootFields
    joint_limits: dict[str, _Limits] = {}
    standing: dict[str, _Number] = {}
    servo: _ServoFields
