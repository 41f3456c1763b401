"""Write a robot as MJCF, the model format of MuJoCo: masses, inertias, joint limits, motors and collision shapes."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from hexakin.checks import Array, checked
from hexakin.robot.model import GRAVITY, SEGMENT_NAMES, Body, Robot
from hexakin.robot.urdf import TORSO
from hexakin.transforms import pose


@checked
def to_mjcf(robot: Robot) -> str:
    """Return the robot as MJCF text, in SI units and radians.

    Bodies, with the names of the URDF's links: ``torso`` with a free joint ``base`` and, for leg i = 1..L, ``coxa_i``,
    ``femur_i``, ``tibia_i`` and ``foot_i``, which is fixed to the tibia. Joints: ``<joint name>_i`` in the table's
    names, about the local z axis, with their limits. Each body has one geom of its name: a box, and for the foot a
    sphere. Each joint has one motor of its name, whose control signal is the torque [N m], at most the servo's.
    Coordinates are the position [m] and the quaternion (w first) of the torso, then the joint angles [rad] leg by leg.

    Parts of the robot do not collide with each other. The text has no ground and no contact parameters. A body of
    which an edge or the radius is 0 has no geom, since MuJoCo has no flat shapes.
    """
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", gravity=_text(0.0, 0.0, -GRAVITY))
    own = ET.SubElement(ET.SubElement(root, "default"), "default", {"class": "robot"})
    # A geom collides with others of which conaffinity has the bit of its contype: with a ground, not with the robot.
    ET.SubElement(own, "geom", contype="1", conaffinity="0")
    torso = ET.SubElement(ET.SubElement(root, "worldbody"), "body", name=TORSO, childclass="robot")
    ET.SubElement(torso, "freejoint", name="base")
    _contents(torso, robot.torso, np.eye(4), "box", robot.torso.size / 2.0)
    motors = ET.SubElement(root, "actuator")
    strongest = _text(-robot.servo.max_torque, robot.servo.max_torque)
    for index in range(robot.num_legs):
        number, parent = index + 1, torso
        fixed, frames = robot.fixed_poses(index), robot.segment_poses(index)
        for k, segment in enumerate(SEGMENT_NAMES):
            body, joint = robot.segments[segment], f"{robot.table.joints[k]}_{number}"
            parent = _body(parent, f"{segment}_{number}", fixed[k])
            limits = _text(*robot.joint_limits[index, k])
            ET.SubElement(parent, "joint", name=joint, type="hinge", axis="0 0 1", range=limits)
            _contents(parent, body, frames[k], "box", body.size / 2.0)
            ET.SubElement(motors, "motor", name=joint, joint=joint, ctrlrange=strongest)
        foot = _body(parent, f"foot_{number}", fixed[-1])
        _contents(foot, robot.foot, np.eye(4), "sphere", np.array([robot.foot_radius]))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _text(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)


def _place(T: Array) -> dict[str, str]:
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
    return {"pos": _text(*T[:3, 3]), "quat": _text(w, x, y, z)}


def _body(parent: ET.Element, name: str, T_parent_body: Array) -> ET.Element:
    return ET.SubElement(parent, "body", {"name": name, **_place(T_parent_body)})


def _contents(element: ET.Element, body: Body, T_element_body: Array, shape: str, size: Array) -> None:
    """Add mass and shape of a body to its element; the shape is centred on the centre of mass."""
    T_center = T_element_body @ pose(np.eye(3), body.center_of_mass)
    # Principal axes, because MuJoCo finds those of a full tensor to a fixed tolerance of 1e-12 kg m^2 only.
    moments, axes = np.linalg.eigh(body.inertia)
    axes *= np.sign(np.linalg.det(axes))  # a rotation
    principal = T_center @ pose(axes, np.zeros(3))
    inertia = {"mass": _text(body.mass), "diaginertia": _text(*moments)}
    ET.SubElement(element, "inertial", inertia | _place(principal))
    if size.min() > 0.0:
        geom = {"name": element.attrib["name"], "type": shape, "size": _text(*size)}
        ET.SubElement(element, "geom", geom | _place(T_center))
