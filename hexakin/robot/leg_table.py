"""The Denavit-Hartenberg table of a leg."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Literal

import numpy as np

from hexakin.checks import Array, checked
from hexakin.transforms import axis_rotation, pose

NUM_JOINTS = 3
"""Number of actuated joints per leg."""

_PI_MULTIPLE = re.compile(r"([+-]?)(\d{1,6})?\*?pi(?:/(\d{1,6}))?")


def pi_multiple(entry: str | int) -> Fraction | None:
    """Return the factor of pi in ``entry`` (``"-pi/2"`` gives -1/2, 0 gives 0); None if it is a name."""
    if entry == 0:
        return Fraction(0)
    match = _PI_MULTIPLE.fullmatch(str(entry).replace(" ", ""))
    if not match or match[3] == "0":
        return None
    return Fraction(int(match[2] or 1), int(match[3] or 1)) * (-1 if match[1] == "-" else 1)


@checked
@dataclass(frozen=True)
class DHRow:
    """One row of a Denavit-Hartenberg table.

    ``theta`` is the turn about z, ``d`` the shift along z, ``a`` the shift along x and ``alpha`` the turn about x. Each
    is 0, a multiple of pi such as ``"pi/2"``, or the name of a joint or parameter.
    """

    theta: str | int
    d: str | int
    a: str | int
    alpha: str | int


@checked
@dataclass(frozen=True)
class LegTable:
    """The Denavit-Hartenberg table of a leg.

    ``convention`` is ``"classical"``, Rz(theta) Tz(d) Tx(a) Rx(alpha) per row (A Table 3), or ``"modified"``, Rx(alpha)
    Tx(a) Rz(theta) Tz(d) per row (Khalil's convention, used by paper B). ``rows`` are the rows. ``joints`` are the
    names of the theta entries that are joint angles. ``mount`` is the position (x, y, z) of the table's first frame in
    the body frame, without rotation; it is empty if the first frame is the body frame.
    """

    convention: Literal["classical", "modified"]
    rows: tuple[DHRow, ...]
    joints: tuple[str, ...]
    mount: tuple[str | int, ...] = ()

    @cached_property
    def motions(self) -> tuple[tuple[str, str | int], ...]:
        """The table as a sequence of elementary motions, such as ``("rz", "theta_1")``; entries 0 are left out."""
        motions: list[tuple[str, str | int]] = list(zip(("tx", "ty", "tz"), self.mount, strict=False))
        for row in self.rows:
            screw_z, screw_x = [("rz", row.theta), ("tz", row.d)], [("tx", row.a), ("rx", row.alpha)]
            motions += screw_z + screw_x if self.convention == "classical" else screw_x[::-1] + screw_z
        return tuple((motion, entry) for motion, entry in motions if entry != 0)

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names in the table that are not joints, in the order in which they appear."""
        names = [str(e) for _, e in self.motions if pi_multiple(e) is None and e not in self.joints]
        return tuple(dict.fromkeys(names))

    def canonical(self) -> LegTable:
        """Return the table with joints named q0, q1, q2 and parameters p0, p1, ...

        The tables of two legs of the same type are then equal.
        """
        names = {name: f"q{i}" for i, name in enumerate(self.joints)}
        names |= {name: f"p{i}" for i, name in enumerate(self.parameters)}
        rows = [DHRow(*(names.get(str(e), e) for e in (r.theta, r.d, r.a, r.alpha))) for r in self.rows]
        mount = tuple(names.get(str(entry), entry) for entry in self.mount)
        return LegTable(self.convention, tuple(rows), tuple(names[joint] for joint in self.joints), mount)

    @cached_property
    def type_key(self) -> str:
        """A line of text that is equal for all tables of the same leg type, whatever names they use."""
        table = self.canonical()
        rows = (f"{row.theta} {row.d} {row.a} {row.alpha}" for row in table.rows)
        mount = f" at {' '.join(map(str, table.mount))}" if table.mount else ""
        return f"{self.convention}{mount}: " + " | ".join(rows)

    def fixed_poses(self, values: Mapping[str, float]) -> Array:
        """Return the constant poses (4, 4, 4) before each of the three joints and after the last joint.

        ``values`` are the values [m, rad] of the table's parameters by name. Joint k turns about the z axis of the
        frame that pose k leads to.
        """
        poses = [np.eye(4)]
        for motion, entry in self.motions:
            if entry in self.joints:
                poses.append(np.eye(4))
                continue
            exact = pi_multiple(entry)
            value = float(exact) * np.pi if exact is not None else values[str(entry)]
            axis = np.eye(3)["xyz".index(motion[1])]
            step = pose(axis_rotation(axis, value), np.zeros(3)) if motion[0] == "r" else pose(np.eye(3), value * axis)
            poses[-1] = poses[-1] @ step
        return np.array(poses)
