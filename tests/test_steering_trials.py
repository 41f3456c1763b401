"""Steering tried out: commands of equal strokes in every direction, and what is measured of a walk."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError, UnknownNameError
from hexakin.papers import steering_trials


def test_study_has_every_robot_gait_and_direction_once():
    study = steering_trials.study()
    assert len(study) == len(steering_trials.ROBOTS) * 4 * 10


@pytest.mark.parametrize("gait", ["tripod", "wave"])
@pytest.mark.parametrize("direction", ["0 deg", "135 deg", "turn right"])
def test_strokes_are_equally_long_in_every_gait_and_direction(athena, gait, direction):
    twist, cycle = steering_trials.command(athena, gait, direction)
    controller = hk.steering.SteeringController(athena, twist, gait, cycle_duration=cycle)
    speed = np.linalg.norm(controller.velocity(twist, controller.home), axis=1).mean()
    assert speed * hk.gait.GAITS[gait](athena).duty_factor * cycle == pytest.approx(steering_trials.STROKE)


def test_a_walk_to_the_left_is_measured_as_such():
    found = steering_trials.steered("athena", "tetrapod", "90 deg", 5)
    twist, _ = steering_trials.command(hk.load_robot("athena"), "tetrapod", "90 deg")
    assert found["left"] == pytest.approx(twist.left, rel=0.1) and abs(found["forward"]) < 0.02 * twist.left
    assert found["error"] < 0.1 and found["torso_contact"] == 0.0 and 0.0 < found["slip"] <= found["slip_most"] < 0.01


def test_what_cannot_be_tried_is_named(athena):
    with pytest.raises(UnknownNameError, match="30 deg"):
        steering_trials.command(athena, "tripod", "30 deg")
    with pytest.raises(InvalidInputError, match="radius"):
        steering_trials.steered("hwr", "tripod", "0 deg", 3)
