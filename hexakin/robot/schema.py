"""The fields of a robot description: the meaning, unit, bounds and an example of each. Pydantic checks them.

All of this is defined only here: ``file`` checks robot files with these models, ``schema_page`` prints them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from hexakin.robot.leg_table import NUM_JOINTS, pi_multiple


class FieldError(Exception):
    """The value of a field is not allowed; the message starts with the field's path."""


class Bounds(NamedTuple):
    """The allowed values of a field, ``low`` to ``high`` in ``unit``, and the reason ``why``.

    A value outside is most likely in a wrong unit.
    """

    low: float
    high: float
    unit: str
    why: str

    def outside(self, value: float) -> bool:
        """Return whether ``value`` is outside the bounds; true for a number that is not finite."""
        return not self.low <= value <= self.high

    def hint(self, key: str, value: float) -> str:
        """Return advice for a ``value`` that is outside the bounds and has the ``key`` in the file."""
        suffix = {"m": "_mm", "rad": "_deg"}.get(self.unit)
        if suffix and abs(value) > self.high and not key.endswith(suffix):
            return f"{key} is in {self.unit}; did you mean {key}{suffix}?"
        if suffix and abs(value) < self.low and key.endswith(suffix):
            return f"{key} is in {suffix[1:]}; did you mean {key.removesuffix(suffix)}, in {self.unit}?"
        return "are the units right?"


# The lightest walking machines weigh a third of a gram and are 2 cm long (HAMR-Jr, ICRA 2020). The heaviest weigh some
# tonnes and are 5 m long (the Adaptive Suspension Vehicle, Song and Waldron 1989). The bounds are much wider than both.
MASS = Bounds(1e-6, 1e5, "kg", "from a micro-robot's segment to more than any walking machine")
EDGE = Bounds(1e-5, 20.0, "m", "from a foil to more than any walking machine")
LENGTH = Bounds(1e-3, 10.0, "m", "from a micro-robot's leg to more than any walking machine's")
OFFSET = Bounds(-10.0, 10.0, "m", "more than any walking machine")
RADIUS = Bounds(0.0, 5.0, "m", "more than any walking machine's foot")
ANGLE = Bounds(
    -4.0 * math.pi, 4.0 * math.pi, "rad", "two turns in each direction; a larger number is probably in degrees"
)
MOMENT = Bounds(1e-20, 1e8, "kg m^2", "up to more than 100 t of 20 m; each body is also checked against its box")
PRODUCT = Bounds(-1e8, 1e8, "kg m^2", "as for the moments")
TORQUE = Bounds(1e-6, 1e5, "N m", "from a micro-robot's actuator to more than an excavator's")
RATE = Bounds(0.1, 1e4, "1/s", "a time constant from 10 s to 0.1 ms")
SPEED = Bounds(1e-2, 1e3, "rad/s", "from one turn in ten minutes to 10000 turns per minute")
MAX_LEGS, MAX_ROWS = 64, 8


def _field(
    description: str, example: Any, *, bounds: Bounds | None = None, assumed: str | None = None, **more: Any
) -> Any:
    """Describe a field.

    A field with ``assumed`` and a ``default`` in ``more`` is optional; ``assumed`` says what holds without it.
    """
    extra: Any = {"bounds": bounds, "assumed": assumed}
    return Field(description=description, examples=[example], json_schema_extra=extra, **more)


def _angle(value: Any) -> Any:
    exact = pi_multiple(value) if isinstance(value, str) else None
    return value if exact is None else float(exact) * math.pi


def _entry(value: str | int) -> str | int:
    if isinstance(value, int) and value != 0:
        raise ValueError("a length or angle other than 0 needs a name; give its value under parameters")
    if isinstance(value, str) and pi_multiple(value) is None and not value.isidentifier():
        raise ValueError("expected 0, a multiple of pi such as pi/2, or a name")
    return value


_Text = Annotated[str, Field(min_length=1, max_length=200)]
_Number = Annotated[float, BeforeValidator(_angle), Field(allow_inf_nan=False, strict=True)]
_Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False, strict=True)]
_Vector = Annotated[list[_Number], Field(min_length=3, max_length=3)]
_PositiveVector = Annotated[list[_Positive], Field(min_length=3, max_length=3)]
_Limits = Annotated[list[_Number], Field(min_length=2, max_length=2)]
_Entry = Annotated[str | int, AfterValidator(_entry)]


class Fields(BaseModel):
    """A group of fields. An unknown field is an error, because it is probably misspelt."""

    model_config = ConfigDict(extra="forbid")

    @field_validator("*")
    @classmethod
    def _within_bounds(cls, given: Any, info: ValidationInfo) -> Any:
        extra: Any = cls.model_fields[str(info.field_name)].json_schema_extra or {}
        bounds = extra.get("bounds")
        for at, value in _numbers(given) if bounds else ():
            if bounds.outside(value):
                about = {"at": at, "number": f"{value:g}", "value": value, "bounds": bounds}
                expected = f"expected {bounds.low:g} to {bounds.high:g}"
                raise PydanticCustomError("bounds", "{number} " + f"{bounds.unit}, {expected}", about)
        return given


def _numbers(given: Any, at: str = "") -> Iterator[tuple[str, float]]:
    """Yield each number in a value, with its path."""
    if isinstance(given, dict):
        for name, item in given.items():
            yield from _numbers(item, f"{at}.{name}")
    elif isinstance(given, list):
        for item in given:
            yield from _numbers(item, at)
    elif given is not None:
        yield at, given


class InertiaFields(Fields):
    """Entries of an inertia tensor."""

    xx: _Positive = _field("Moment about x.", 2.52e-3, bounds=MOMENT)
    yy: _Positive = _field("Moment about y.", 1.02e-3, bounds=MOMENT)
    zz: _Positive = _field("Moment about z.", 3.17e-3, bounds=MOMENT)
    xy: _Number = _field("Minus the integral of x y dm.", 0.0, bounds=PRODUCT, assumed="0", default=0.0)
    yz: _Number = _field("Minus the integral of y z dm.", 0.0, bounds=PRODUCT, assumed="0", default=0.0)
    xz: _Number = _field("Minus the integral of x z dm.", 0.0, bounds=PRODUCT, assumed="0", default=0.0)


class BodyFields(Fields):
    """The torso, in the body frame (z up), or a segment, in its own frame: origin at its joint, x to the next joint."""

    mass: _Positive = _field("Mass.", 0.7, bounds=MASS)
    size: _PositiveVector = _field(
        "Edges [x, y, z] of its box, centred on the centre of mass. The box is the shape for contacts with the ground.",
        [0.12, 0.2, 0.056],
        bounds=EDGE,
    )
    inertia: InertiaFields = _field("Inertia tensor about the centre of mass, in the body's axes.", None)
    center_of_mass: _Vector | None = _field(
        "Centre of mass [x, y, z].", [0.0, 0.0, 0.0], bounds=OFFSET, default=None,
        assumed="for the torso the origin; for a segment half-way to the next joint, if all legs have the same length",
    )  # fmt: skip


class FootFields(Fields):
    """The foot, a sphere around the last frame of the leg table, fixed to the tibia."""

    mass: _Positive = _field("Mass.", 0.009, bounds=MASS)
    radius: Annotated[float, Field(ge=0.0, allow_inf_nan=False, strict=True)] = _field(
        "Radius; 0 is a point, which is enough for kinematics but not for simulations.", 0.02, bounds=RADIUS
    )
    inertia: InertiaFields = _field("Inertia tensor about the sphere's centre.", None)


class RowFields(Fields):
    """One row. Each entry is 0, a multiple of pi such as pi/2, or the name of a joint or parameter."""

    theta: _Entry = _field("Turn about z.", "theta_2")
    d: _Entry = _field("Shift along z.", 0)
    a: _Entry = _field("Shift along x.", "l_2")
    alpha: _Entry = _field("Turn about x.", "pi/2")


_ROWS = [
    {"theta": "theta_1", "d": 0, "a": "l_1", "alpha": 0},
    {"theta": "theta_2", "d": 0, "a": "l_2", "alpha": "pi/2"},
    {"theta": "theta_3", "d": 0, "a": "l_3", "alpha": 0},
    {"theta": "theta_4", "d": 0, "a": "l_4", "alpha": 0},
]


class TableFields(Fields):
    """The Denavit-Hartenberg table that all legs share, from the body frame to the centre of the foot."""

    convention: Literal["classical", "modified"] = _field(
        "classical: Rz(theta) Tz(d) Tx(a) Rx(alpha) per row; modified (Khalil's): Rx(alpha) Tx(a) Rz(theta) Tz(d).",
        "classical",
    )
    joints: Annotated[list[str], Field(min_length=NUM_JOINTS, max_length=NUM_JOINTS)] = _field(
        "The three theta entries that are joint angles, from the body outwards.", ["theta_2", "theta_3", "theta_4"]
    )
    rows: Annotated[list[RowFields], Field(min_length=NUM_JOINTS, max_length=MAX_ROWS)] = _field(
        "The rows, each with theta, d, a and alpha.", _ROWS
    )
    mount: Annotated[list[_Entry], Field(min_length=3, max_length=3)] | None = _field(
        "Position [x, y, z] of the first frame in the body frame: 0 or names.", ["x_0", "y_0", 0], default=None,
        assumed="the first frame is the body frame",
    )  # fmt: skip
    parameters: dict[str, _Number] = _field(
        "Values for all legs, by name: lengths in m and angles in rad.", {"l_2_mm": 64, "l_3_mm": 80, "l_4_mm": 84},
        default={}, assumed="none; each leg then needs its own",
    )  # fmt: skip


class LegFields(Fields):
    """Values of a single leg."""

    name: _Text = _field("The leg's name; all names must differ.", "right middle")
    parameters: dict[str, _Number] = _field(
        "Values for this leg only, by the names in the leg table.",
        {"theta_1": 0, "l_1_mm": 60},
        default={},
        assumed="none",
    )
    joint_limits: dict[str, _Limits] = _field(
        "Joint limits for this leg only.",
        {"theta_2": [-0.5, 0.5]},
        bounds=ANGLE,
        default={},
        assumed="joint_limits below",
    )
    standing: dict[str, _Number] = _field(
        "Standing angles for this leg only.", {"theta_2": 0.1}, bounds=ANGLE, default={}, assumed="standing below"
    )


class ServoFields(Fields):
    """All servos are equal: each drives its joint at the speed rate * (command - angle), with at most max_torque."""

    max_torque: _Positive = _field("Largest torque.", 1.89, bounds=TORQUE)
    rate: _Positive = _field(
        "Speed per angle that the joint lags behind; its inverse is the time constant.", 20.0, bounds=RATE
    )
    max_speed: _Positive | None = _field(
        "Largest speed, for feasibility checks.",
        6.5,
        bounds=SPEED,
        default=None,
        assumed="it is unknown and not checked",
    )


def _body(mass: float, length: float, axial: float, across: float) -> dict[str, Any]:
    return {"mass": mass, "size": [length, 0.04, 0.04], "inertia": {"xx": axial, "yy": across, "zz": across}}


class SegmentsFields(Fields):
    """The three segments of every leg."""

    coxa: BodyFields = _field("Between the first and the second joint.", _body(0.081, 0.064, 2.16e-5, 3.84e-5))
    femur: BodyFields = _field("Between the second and the third joint.", _body(0.136, 0.080, 3.63e-5, 9.07e-5))
    tibia: BodyFields = _field(
        "From the third joint to the foot, without the foot.", _body(0.013, 0.084, 3.47e-6, 9.38e-6)
    )


_FOOT = {"mass": 0.009, "radius": 0.02, "inertia": {"xx": 1.44e-6, "yy": 1.44e-6, "zz": 1.44e-6}}
_CORNER = {"l_1_mm": 116.6}
_LEGS = [
    {"name": "right middle", "parameters": {"theta_1": 0, "l_1_mm": 60}},
    {"name": "right front", "parameters": {"theta_1_deg": 59, **_CORNER}},
    {"name": "left front", "parameters": {"theta_1_deg": 121, **_CORNER}},
    {"name": "left middle", "parameters": {"theta_1": "pi", "l_1_mm": 60}},
    {"name": "left rear", "parameters": {"theta_1_deg": 239, **_CORNER}},
    {"name": "right rear", "parameters": {"theta_1_deg": -59, **_CORNER}},
]


class RobotFields(Fields):
    """All fields of a robot file."""

    name: _Text = _field("The robot's name.", "mine")
    reference: str = _field("Where the robot is described.", "Doe 2024", default="", assumed="nothing")
    num_legs: Annotated[int, Field(ge=1, le=MAX_LEGS, strict=True)] = _field("Number of legs.", 6)
    forward: _Vector = _field("Direction of walking in the body frame: a horizontal unit vector.", [0, 1, 0])
    torso: BodyFields = _field("The body that carries the legs; its frame is the body frame, z up.", None)
    leg_table: TableFields = _field("The legs' kinematics.", None)
    legs: Annotated[list[LegFields], Field(max_length=MAX_LEGS)] = _field(
        "The num_legs legs, in order around the body: the tripod gait swings the first, third and fifth together.",
        _LEGS,
    )
    segments: SegmentsFields = _field("The segments, equal for all legs.", None)
    foot: FootFields = _field("The foot, equal for all legs.", _FOOT)
    joint_limits: dict[str, _Limits] = _field(
        "Lower and upper limit of each joint.",
        {"theta_2": [-0.6, 0.6], "theta_3": [-1.5, 1.5], "theta_4_deg": [-150, 85]},
        bounds=ANGLE, default={}, assumed="none; each leg then needs its own",
    )  # fmt: skip
    standing: dict[str, _Number] = _field(
        "Angle of each joint in the standing pose, within its limits.",
        {"theta_2": 0, "theta_3": 0, "theta_4": "-pi/2"},
        bounds=ANGLE, default={}, assumed="none; each leg then needs its own",
    )  # fmt: skip
    servo: ServoFields = _field("The servos of all joints.", None)
