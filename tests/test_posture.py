"""The posture controller against A(27)-(31), A Fig. 6, and with bad parameters."""

import numpy as np
import pytest

import hexakin as hk
from hexakin.control.interface import Observation
from hexakin.exceptions import InvalidInputError, UnknownNameError

RATE = 20.0
LOADED = np.full(6, 3.5)


def walk(controller, ticks, *, height=0.104, force=LOADED, perfect=True):
    """Drive a controller whose servos follow at once; ``force`` may be a function of the tick."""
    q = controller.robot.standing_q
    run, commands = None, []
    for tick in range(ticks):
        forces = force(tick) if callable(force) else force
        observation = Observation.at_rest(tick / RATE, q, forces, height)
        run = run or controller.start(observation, RATE)
        commands.append(run.command(observation))
        q = commands[-1].q if perfect else q
    return commands


def feet(controller, commands):
    return hk.forward_kinematics(controller.robot, np.array([command.q for command in commands]))


def test_a_phase_moves_the_swing_feet_ahead_and_the_stance_feet_back_by_the_stride(athena):
    controller = hk.PostureController(athena, k_z=0, k_alpha=0, k_beta=0)
    start = hk.forward_kinematics(athena, athena.standing_q)
    path = feet(controller, walk(controller, 40))
    assert path[19] - start == pytest.approx(np.outer([1, -1, 1, -1, 1, -1], [0, 0.05, 0]), abs=1e-12)
    assert path[39] == pytest.approx(start, abs=1e-12)
    assert (path[:20, ::2, 2] - start[::2, 2]).max() == pytest.approx(0.03, rel=1e-3)
    assert path[:20, 1::2, 2] == pytest.approx(np.broadcast_to(start[1::2, 2], (20, 3)), abs=1e-12)


def test_half_a_stride_first_centres_the_strokes_on_the_standing_footholds(athena):
    controller = hk.PostureController(athena, k_z=0, k_alpha=0, first_phase="half_stride")
    start = hk.forward_kinematics(athena, athena.standing_q)
    path = feet(controller, walk(controller, 40))
    assert np.abs(path[19] - start)[:, 1] == pytest.approx(np.full(6, 0.025), abs=1e-12)
    assert np.abs(path[39] - start)[:, 1] == pytest.approx(np.full(6, 0.025), abs=1e-12)


def test_a_low_torso_pushes_stance_feet_down_and_plants_swing_feet_lower(athena):
    """A(27) and A(30) with delta_z = measured - reference: a negative error lowers the feet, which lifts the torso."""
    controller = hk.PostureController(athena, k_z=0.5, k_alpha=0, k_beta=0)
    start = hk.forward_kinematics(athena, athena.standing_q)
    commands = walk(controller, 20, height=0.084)
    assert commands[0].diagnostics["delta_z"] == pytest.approx(-0.02)
    assert feet(controller, commands)[-1, :, 2] - start[:, 2] == pytest.approx(np.full(6, -0.01), abs=1e-12)


def test_displacement_as_printed_is_the_rotated_translation_for_every_foot(athena):
    controller = hk.PostureController(athena, k_z=0.8, k_alpha=0.6, k_beta=0.4)
    start = hk.forward_kinematics(athena, athena.standing_q)
    a, b, dz = 0.6 * 0.1, 0.4 * 0.2, 0.8 * -0.01
    rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    t_r = rx @ ry @ [0, -0.05, dz]
    assert controller.stance_displacement(start, -0.01, 0.1, 0.2) == pytest.approx(np.tile(t_r, (6, 1)), abs=1e-15)


@pytest.mark.parametrize("delta_alpha, delta_beta", [(0.1, 0.0), (0.0, -0.1)])
def test_turning_the_footholds_levels_the_ground_relative_to_the_torso(athena, delta_alpha, delta_beta):
    """With unit gains feet on tilted ground end on a plane parallel to the torso; R for R^T would double the tilt."""
    controller = hk.PostureController(athena, k_z=0, k_alpha=1, k_beta=1, reading="rotate_foothold")
    start = hk.forward_kinematics(athena, athena.standing_q)
    start[:, 2] += np.tan(delta_alpha) * start[:, 1] - np.tan(delta_beta) * start[:, 0]
    end = start + controller.stance_displacement(start, 0.0, delta_alpha, delta_beta)
    assert np.ptp(start[:, 2]) > 0.01
    fitted = np.linalg.lstsq(np.column_stack([end[:, :2], np.ones(6)]), end[:, 2], rcond=None)[0]
    assert np.abs(fitted[:2]).max() < 1e-12


def test_fewer_than_three_contacts_extend_the_other_legs_until_they_touch(athena):
    controller = hk.PostureController(athena)
    two = np.array([3.5, 3.5, 0, 0, 0, 0])
    commands = walk(controller, 10, force=lambda tick: two if tick < 4 else LOADED)
    path = feet(controller, commands)
    start = hk.forward_kinematics(athena, athena.standing_q)
    assert [command.extending for command in commands] == [True] * 4 + [False] * 6
    assert path[3, 2:, 2] - start[2:, 2] == pytest.approx(np.full(4, -4 * 0.05 / RATE), abs=1e-12)
    assert path[3, :2] == pytest.approx(start[:2], abs=1e-12)
    assert commands[4].phase == 0


def test_extension_gives_up_at_its_limit_and_keeps_the_old_estimate(athena):
    controller = hk.PostureController(athena, max_extension=0.01)
    commands = walk(controller, 30, force=np.zeros(6))
    extending = [command.extending for command in commands]
    assert sum(extending) == 4 + 4, "10 mm at 2.5 mm a tick, at both phase changes"
    assert commands[-1].diagnostics["delta_alpha"] == 0.0


def test_estimates_are_made_once_a_phase_or_once_a_cycle(athena):
    def deltas(every):
        controller = hk.PostureController(athena, k_z=0, estimate_every=every)
        run, found = None, []
        for tick in range(80):
            observation = Observation.at_rest(tick / RATE, athena.standing_q, LOADED, 0.09 + 1e-4 * tick)
            run = run or controller.start(observation, RATE)
            found.append(run.command(observation).diagnostics["delta_z"])
        return len(set(found))

    assert deltas(1) == 4
    assert deltas(2) == 2


def test_starting_from_actual_angles_or_the_command_differs_when_servos_lag(athena):
    """With servos that do not move at all, every phase starts where the feet are, or where they were sent."""
    start = hk.forward_kinematics(athena, athena.standing_q)
    actual = hk.PostureController(athena, k_z=0, k_alpha=0, start_from="actual")
    command = hk.PostureController(athena, k_z=0, k_alpha=0, start_from="command")
    assert feet(actual, walk(actual, 40, perfect=False))[39, 0, 1] - start[0, 1] == pytest.approx(-0.05, abs=1e-12)
    assert feet(command, walk(command, 40, perfect=False))[39, 0, 1] - start[0, 1] == pytest.approx(0.0, abs=1e-12)


def test_targets_out_of_reach_are_clipped_and_reported(athena):
    controller = hk.PostureController(athena, k_z=0, k_alpha=0, stride=0.2)
    commands = walk(controller, 20)
    assert any(command.limited.any() for command in commands)
    low, high = athena.q_min, athena.q_max
    for command in commands:
        assert np.isfinite(command.q).all()
        assert (command.q >= low).all() and (command.q <= high).all()


def test_equal_runs_give_equal_commands(athena):
    controller = hk.PostureController(athena, seed=3)
    first, second = walk(controller, 60), walk(controller, 60)
    assert all(np.array_equal(a.q, b.q) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize(
    "arguments, error, message",
    [
        ({"k_z": 1.2}, InvalidInputError, "k_z: 1.2, expected .*at most 1"),
        ({"k_alpha": np.nan}, InvalidInputError, "k_alpha: nan"),
        ({"phase_duration": 0.0}, InvalidInputError, "phase_duration"),
        ({"stride": -0.1}, InvalidInputError, "stride: -0.1 m"),
        ({"reading": "literal"}, UnknownNameError, "unknown reading 'literal'; known: as_printed, rotate_foothold"),
        ({"start_from": "here"}, UnknownNameError, "start_from"),
        ({"first_phase": "none"}, UnknownNameError, "first_phase"),
        ({"reference_height": -1.0}, InvalidInputError, "reference_height"),
    ],
)
def test_bad_parameters_are_named(athena, arguments, error, message):
    with pytest.raises(error, match=message):
        hk.PostureController(athena, **arguments)


def test_a_phase_must_be_a_whole_number_of_ticks(athena):
    controller = hk.PostureController(athena, phase_duration=0.33)
    with pytest.raises(InvalidInputError, match=r"phase_duration: 0\.33 s is not a whole number of ticks at 20 Hz"):
        controller.start(Observation.at_rest(0.0, athena.standing_q, LOADED, 0.104), RATE)


def test_a_phase_of_many_ticks_is_one_even_path(athena):
    """Foot targets are computed for 100 ticks at once; stance feet move on a line, by the same distance each tick."""
    controller = hk.PostureController(athena, phase_duration=15.0)
    commands = walk(controller, 300)
    stance = commands[0].stance
    path = feet(controller, commands)
    steps = np.diff(path[:, stance], axis=0)
    assert np.abs(steps - steps[0]).max() < 1e-9 and np.abs(steps[0]).max() > 1e-5
    along = path[:, ~stance] @ athena.forward
    assert (np.diff(along, axis=0) > 0.0).all()
    assert along[-1] - along[0] == pytest.approx(np.full(3, 0.05), rel=0.02)
