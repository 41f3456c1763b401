"""Write a robot as URDF: masses, inertias, joint limits and collision shapes."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from hexakin.checks import Array, checked
from hexakin.exceptions import InvalidInputError
from hexakin.robot.model import SEGMENT_NAMES, Body, Robot
from hexakin.transforms import pose

TORSO = "torso"
# [rad/s] URDF requires a velocity limit. The papers give none; this value (assumed) is far above that of any servo.
_UNLIMITED_SPEED = 100.0


@checked
def to_urdf(robot: Robot) -> str:
    """Return the robot as URDF text.

    Links: ``torso`` and, for leg i = 1..L, ``coxa_i``, ``femur_i``, ``tibia_i`` (boxes) and ``foot_i`` (a
    sphere, fixed to the tibia). Joints: ``<joint name>_i`` in the table's names, about the local z axis. Total mass
    and foot positions are those of the description. Raises InvalidInputError if the feet are points (radius 0), because
    a point cannot touch anything in a simulation.
    """
    if robot.foot_radius == 0.0:
        raise InvalidInputError(f"robot {robot.name!r}: foot.radius is 0; a simulation needs a radius above 0")
    root = ET.Element("robot", name=robot.name)
    _link(root, TORSO, robot.torso, np.eye(4), _box(robot.torso))
    for index in range(robot.num_legs):
        number = index + 1
        fixed, frames = robot.fixed_poses(index), robot.segment_poses(index)
        parent = TORSO
        for k, segment in enumerate(SEGMENT_NAMES):
            name, body = f"{segment}_{number}", robot.segments[segment]
            _link(root, name, body, frames[k], _box(body))
            joint = _joint(root, f"{robot.table.joints[k]}_{number}", "revolute", parent, name, fixed[k])
            low, high = robot.joint_limits[index, k]
            limits = {"lower": low, "upper": high, "effort": robot.servo.max_torque, "velocity": _UNLIMITED_SPEED}
            ET.SubElement(joint, "axis", xyz="0 0 1")
            ET.SubElement(joint, "limit", {key: _text(value) for key, value in limits.items()})
            parent = name
        foot = ET.Element("sphere", radius=_text(robot.foot_radius))
        _link(root, f"foot_{number}", robot.foot, np.eye(4), foot)
        _joint(root, f"ankle_{number}", "fixed", parent, f"foot_{number}", fixed[-1])
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _text(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)


def _origin(parent: ET.Element, T: Array) -> None:
    roll, pitch, yaw = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
    ET.SubElement(parent, "origin", xyz=_text(*T[:3, 3]), rpy=_text(roll, pitch, yaw))


def _box(body: Body) -> ET.Element:
    return ET.Element("box", size=_text(*body.size))


def _link(root: ET.Element, name: str, body: Body, T_link_body: Array, shape: ET.Element) -> None:
    link = ET.SubElement(root, "link", name=name)
    T_link_center = T_link_body @ pose(np.eye(3), body.center_of_mass)
    inertial = ET.SubElement(link, "inertial")
    _origin(inertial, T_link_center)
    ET.SubElement(inertial, "mass", value=_text(body.mass))
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia
    tensor = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
    ET.SubElement(inertial, "inertia", {key: _text(value) for key, value in tensor.items()})
    for kind in ("visual", "collision"):
        element = ET.SubElement(link, kind)
        # The box is centred on the centre of mass.
        _origin(element, T_link_center)
        ET.SubElement(element, "geometry").append(shape)


def _joint(root: ET.Element, name: str, kind: str, parent: str, child: str, T_parent_child: Array) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    _origin(joint, T_parent_child)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint
