"""Sliders: postures, pictures and messages agree with the values of the sliders."""

import io
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import hexakin as hk
from hexakin import sliders
from hexakin.exceptions import InvalidInputError
from hexakin.kinematics import standing_height
from hexakin.transforms import rpy_rotation, transform_points


@pytest.fixture
def body(athena):
    return sliders.body_pose(athena)


def pixels(shown):
    return np.asarray(Image.open(io.BytesIO(shown.png)).convert("RGB")).astype(int)


def fault_pixels(shown):
    """Number of pixels that have the colour of faults, or nearly."""
    return int((np.abs(pixels(shown) - [0xB2, 0x00, 0x2D]).max(axis=-1) < 30).sum())


def test_the_body_stands_where_the_sliders_say_and_the_feet_stay(athena, body):
    for name, value in {"x": 12.0, "z": -9.0, "roll, about x": 4.0, "yaw, about z": -6.0}.items():
        body.sliders[name].value = value
    T = body.posture.T_world_body
    np.testing.assert_allclose(T[:3, 3], [0.012, 0.0, standing_height(athena) - 0.009], atol=1e-12)
    np.testing.assert_allclose(T[:3, :3], rpy_rotation(np.radians([4.0, 0.0, -6.0])), atol=1e-12)
    feet = transform_points(T, hk.forward_kinematics(athena, body.posture.q))
    standing = hk.forward_kinematics(athena, athena.standing_q) + [0.0, 0.0, standing_height(athena)]
    np.testing.assert_allclose(feet, standing, atol=1e-12)
    assert not body.posture.faults and "within reach" in body.text and fault_pixels(body) == 0


def test_the_picture_follows_and_the_button_brings_the_standing_pose_back(athena, body):
    before = body.png
    body.sliders["pitch, about y"].value = 10.0
    assert body.png != before
    body.reset.click()
    assert body.png == before and body.sliders["pitch, about y"].value == 0.0
    np.testing.assert_allclose(body.posture.q, athena.standing_q, atol=1e-12)


def test_a_leg_out_of_reach_is_named_drawn_in_red_and_keeps_its_pose(athena, body):
    body.sliders["x"].value = 40.0
    held = body.posture.q
    body.sliders["x"].value = 80.0
    lost = [leg for leg, said in body.posture.faults.items() if "exceeds its reach" in said]
    assert lost and lost == sorted(lost) and fault_pixels(body) > 100
    for leg in lost:
        assert f"leg {leg}: foot target" in body.text and np.array_equal(body.posture.q[leg - 1], held[leg - 1])
    body.sliders["x"].value = 0.0
    np.testing.assert_allclose(body.posture.q, athena.standing_q, atol=1e-12)
    assert not body.posture.faults


def test_a_torso_in_the_floor_is_named(body):
    body.sliders["z"].value = -80.0
    assert "torso: 4.0 mm below the floor" in body.text  # 104 mm of standing height - 80 mm - 56 mm / 2


def test_angles_beyond_the_limits_are_named_and_drawn_in_red(athena):
    leg = sliders.leg_angles(athena, 3)
    joint, (_, high) = athena.table.joints[0], np.degrees(athena.joint_limits[2, 0])
    leg.sliders[joint].value = high - 0.5
    assert not leg.posture.faults
    leg.sliders[joint].value = high + 2.0
    assert leg.text.startswith(f"leg 3: {joint} = {high + 2.0:.1f} deg leaves its limits") and fault_pixels(leg) > 100
    np.testing.assert_allclose(leg.posture.q[2, 0], np.radians(high + 2.0), atol=1e-9)
    assert np.array_equal(np.delete(leg.posture.q, 2, axis=0), np.delete(athena.standing_q, 2, axis=0))


@pytest.mark.parametrize("leg", [0, 7, 1.5])
def test_a_leg_that_the_robot_does_not_have_is_refused(athena, leg):
    with pytest.raises(InvalidInputError, match="leg"):
        sliders.leg_angles(athena, leg)


def test_pages_without_a_kernel_get_the_picture(body):
    shown = body._repr_mimebundle_(include=None, exclude=None)
    assert "application/vnd.jupyter.widget-view+json" in shown and len(shown["image/png"]) > 1e4


def test_a_missing_ipywidgets_is_named():
    script = (
        "import sys\nsys.modules['ipywidgets'] = None\nimport hexakin as hk\n"
        "try:\n    hk.sliders.body_pose(hk.load_robot('athena'))\n"
        "except hk.exceptions.MissingPackageError as error:\n    print(error)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "needs the package 'ipywidgets'" in done.stdout and "pip install ipywidgets" in done.stdout
