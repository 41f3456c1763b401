import dataclasses

import numpy as np
import pytest

import hexakin as hk
from hexakin.exceptions import InvalidInputError
from hexakin.motion.measures import body_rates, per_cycle, quartiles, rms


def test_root_mean_square_and_quartiles_of_known_samples():
    assert rms([3.0, 4.0]) == pytest.approx(np.sqrt(12.5))
    sample = quartiles([1, 2, 3, 4, 5])
    assert sample == (2, 3, 4)
    assert sample.iqr == 2


@pytest.mark.parametrize("function", [rms, quartiles])
def test_empty_samples_and_nans_are_refused(function):
    with pytest.raises(InvalidInputError, match="empty"):
        function([])
    with pytest.raises(InvalidInputError, match="nan"):
        function([1.0, np.nan])


def test_pitch_turns_about_x_and_roll_about_y_for_a_robot_that_walks_along_y(short_walk):
    omega = np.tile([1.0, 2.0, 3.0], (120, 1))
    pitch, roll = body_rates(dataclasses.replace(short_walk, body_angular_velocity=omega))
    assert (pitch == 1.0).all() and (roll == 2.0).all()


def test_each_whole_cycle_is_measured_by_itself(short_walk):
    cycles = per_cycle(short_walk)
    assert len(cycles.height) == 3
    first = short_walk.time < 2.0
    assert cycles.height[0] == pytest.approx(np.sqrt(np.mean(short_walk.height[first] ** 2)))


def test_an_unfinished_cycle_is_left_out(short_walk):
    def first(count):
        names = short_walk.columns.keys() - short_walk.diagnostics.keys()
        columns = {name: getattr(short_walk, name)[:count] for name in names}
        return dataclasses.replace(short_walk, **columns, diagnostics={})

    assert len(per_cycle(first(100)).height) == 2
    with pytest.raises(InvalidInputError, match="no whole gait cycle"):
        per_cycle(first(30))


def test_torso_contact_is_counted_per_cycle(short_walk):
    force = np.zeros(120)
    force[40:60] = 1.0
    contact = per_cycle(dataclasses.replace(short_walk, torso_force=force)).torso_contact
    assert contact == pytest.approx([0.0, 0.5, 0.0])


def test_public_name(short_walk):
    assert hk.measures.per_cycle(short_walk).pitch_rate.shape == (3,)
