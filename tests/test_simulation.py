"""The closed loop: determinism, what is recorded, the ramp's known results, bad arguments."""

import importlib.util
from importlib import metadata

import numpy as np
import pytest

import hexakin as hk
from hexakin.engines import Engine, Reading
from hexakin.exceptions import InvalidInputError, SimulationError, UnknownNameError
from hexakin.transforms import pose


def test_equal_arguments_give_bit_identical_recordings(athena, short_walk):
    controller = hk.PostureController(athena)
    again = hk.simulate(athena, hk.terrain.Ramp(), controller, duration=6.0, time_step=0.005)
    for name, values in again.columns.items():
        assert np.array_equal(short_walk.columns[name], values, equal_nan=True)
    assert again.parameters == short_walk.parameters


@pytest.mark.parametrize("engine", ["rigid", pytest.param("pybullet", marks=pytest.mark.pybullet), "mujoco"])
def test_unsolved_steps_are_counted_where_residuals_are_known(athena, engine):
    if engine == "mujoco":
        pytest.importorskip("mujoco")
    walk = hk.simulate(athena, hk.terrain.Plane(), hk.PostureController(athena), engine=engine, duration=0.5)
    table = walk.to_dataframe()
    assert table["unsolved_steps"].isna().equals(table["solver_residual"].isna())
    assert table["unsolved_steps"].isna().all() == (engine != "rigid")


def test_another_seed_gives_another_start(athena, short_walk):
    other = hk.simulate(athena, hk.terrain.Ramp(), hk.PostureController(athena), duration=1.0, time_step=0.005, seed=1)
    assert np.abs(other.q[0] - short_walk.q[0]).max() > 1e-3


def test_a_recording_has_a_row_for_every_tick_and_knows_what_made_it(short_walk):
    n = 120
    shapes = {"time": (n,), "T_world_body": (n, 4, 4), "q": (n, 6, 3), "foot_force": (n, 6), "stance": (n, 6)}
    assert {name: getattr(short_walk, name).shape for name in shapes} == shapes
    parameters = short_walk.parameters
    with_pybullet = importlib.util.find_spec("pybullet") is not None
    assert parameters["engine"] == ("pybullet" if with_pybullet else "rigid")
    assert parameters["engine_choice"] == ("default" if with_pybullet else "default, because PyBullet is not installed")
    assert parameters["robot"]["legs"][0]["values"]["l_1"] == 0.06
    assert parameters["controller"]["k_z"] == 0.8
    assert (parameters["seed"], parameters["time_step"], parameters["friction"]) == (0, 0.005, 0.9)
    assert "Ramp(slope=0.17" in parameters["terrain"]
    assert set(parameters["versions"]) >= {"hexakin", "numpy"}


def test_it_walks_up_the_ramp_on_its_feet(short_walk):
    position = short_walk.T_world_body[:, :3, 3]
    assert position[-1, 1] - position[0, 1] > 0.2
    assert position[-1, 2] > position[0, 2]
    assert (short_walk.torso_force == 0.0).all()
    assert short_walk.penetration.max() < 2e-3
    rotation = short_walk.T_world_body[:, :3, :3]
    assert rotation @ np.swapaxes(rotation, 1, 2) == pytest.approx(np.broadcast_to(np.eye(3), (120, 3, 3)), abs=1e-12)


def test_height_is_measured_along_the_bodys_axis(short_walk):
    """On an inclined plane the range is the distance to the plane over the cosine of the tilt against it."""
    normal = hk.terrain.Ramp().normal(0.0, 0.0)
    gap = short_walk.T_world_body[:, :3, 3] @ normal
    cosine = short_walk.T_world_body[:, :3, 2] @ normal
    assert short_walk.height == pytest.approx(gap / cosine, abs=1e-12)


def test_simple_control_sinks_and_height_control_does_not(athena):
    """At a coarse step and over 12 cycles; the ramp notebook has the full runs."""
    heights = {}
    for k_z in (0.0, 0.8):
        controller = hk.PostureController(athena, k_z=k_z, k_alpha=0.0)
        recording = hk.simulate(athena, hk.terrain.Ramp(), controller, duration=24.0, time_step=0.005)
        heights[k_z] = hk.measures.per_cycle(recording).height
    assert heights[0.0][-1] < 0.08 < heights[0.0][0]
    assert (np.abs(heights[0.8] - 0.1) < 0.005).all()


def test_nothing_sinks_when_phases_start_from_the_last_command(athena):
    controller = hk.PostureController(athena, k_z=0.0, k_alpha=0.0, start_from="command")
    recording = hk.simulate(athena, hk.terrain.Ramp(), controller, duration=24.0, time_step=0.005)
    assert hk.measures.per_cycle(recording).height[-1] > 0.1


@pytest.mark.parametrize(
    "arguments, error, message",
    [
        ({"engine": "ode"}, UnknownNameError, "unknown engine 'ode'"),
        ({"duration": -1.0}, InvalidInputError, "duration: -1"),
        ({"time_step": 0.003}, InvalidInputError, "time_step: 0.003 s does not divide the control tick of 0.05 s"),
        ({"time_step": float("nan")}, InvalidInputError, "time_step: nan"),
        ({"friction": float("nan")}, InvalidInputError, "friction: nan"),
        ({"control_rate": 0.0}, InvalidInputError, "control_rate"),
        ({"seed": -1}, InvalidInputError, "seed: -1"),
        (
            {"engine": "rigid", "gravity": 1.6},
            UnknownNameError,
            "unknown option of engine 'rigid' 'gravity'; known: time_step",
        ),
    ],
)
def test_bad_arguments_are_named(athena, arguments, error, message):
    with pytest.raises(error, match=message):
        hk.simulate(athena, hk.terrain.Plane(), hk.PostureController(athena), **arguments)


def test_an_unknown_terrain_is_named(athena):
    with pytest.raises(InvalidInputError, match="terrain: expected a Terrain, got 'moon'"):
        hk.simulate(athena, "moon", hk.PostureController(athena))


class Overturned(Engine):
    """An engine whose robot lies on its back."""

    def __init__(self, robot, terrain, **options):
        self.robot = robot

    def place(self, T_world_body, q):
        pass

    def advance(self, q_command, num_steps, torque_law=None):
        T = pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 0.1])
        zeros = np.zeros(3)
        feet = np.zeros(6)
        still = np.zeros((6, 3))
        q = np.asarray(q_command)
        return Reading(T, zeros, zeros, np.zeros((3, 3)), q, still, still, feet, feet, 20.0, 0.0, 0.0)

    def close(self):
        pass


def test_a_robot_that_turns_over_ends_the_simulation_by_name(athena, monkeypatch):
    monkeypatch.setitem(hk.engines.ENGINES, "overturned", (__name__, "Overturned"))
    with pytest.raises(SimulationError, match=r"t = 0 s: no ground below the torso"):
        hk.simulate(athena, hk.terrain.Plane(), hk.PostureController(athena), engine="overturned")


def test_a_controller_for_another_robot_of_the_same_name_is_refused(athena, edited):
    longer = edited("athena", lambda tree: tree["leg_table"]["parameters"].update(l_4_mm=100))
    with pytest.raises(InvalidInputError, match="controller: made for another robot"):
        hk.simulate(longer, hk.terrain.Plane(), hk.PostureController(athena))


@pytest.mark.pybullet  # on rigid the robot gets stuck at the edge of this island
def test_leaving_the_terrain_ends_the_simulation_by_name(athena):
    x, y = np.linspace(-0.4, 0.4, 9), np.linspace(-0.4, 0.3, 8)
    island = hk.terrain.HeightField(x, y, np.zeros((9, 8)))
    with pytest.raises(SimulationError, match=r"t = .* s: (the robot has left the terrain|no ground below)"):
        hk.simulate(athena, island, hk.PostureController(athena), engine="pybullet", duration=30.0, time_step=0.005)


@pytest.mark.parametrize("engine", ["pybullet", "rigid", "mujoco"])
def test_a_ticks_rate_moment_and_last_force_are_those_of_its_steps(athena, engine):
    """The same walk read at every step: what a tick reports is what its steps would have."""
    recording = hk.simulate(athena, hk.terrain.Ramp(), hk.PostureController(athena), engine=engine, duration=1.5)
    make = hk.engines.engine_class(engine)
    with (
        make(athena, hk.terrain.Ramp(), time_step=0.001) as one,
        make(athena, hk.terrain.Ramp(), time_step=0.001) as many,
    ):
        T, q = recording.T_world_body[0], recording.q[0]
        for simulator in (one, many):
            simulator.place(T, q)
        for command in recording.q_command:
            tick = one.advance(command, 50)
            steps = [many.advance(command, 1) for _ in range(50)]
            rates = np.array([step.body_angular_velocity for step in steps])
            moment = np.einsum("ni,nj->ij", rates, rates) / 50
            assert tick.body_rate_moment == pytest.approx(moment, abs=1e-3 * np.trace(moment) + 1e-9, rel=1e-2)
            assert tick.foot_force_last == pytest.approx(steps[-1].foot_force, abs=1e-3)
            assert tick.foot_force == pytest.approx(np.mean([step.foot_force for step in steps], axis=0), abs=1e-3)


def test_a_walk_ends_when_its_cycles_are_whole(athena):
    walk = hk.simulate(
        athena, hk.terrain.Plane(), hk.PostureController(athena), duration=20.0, max_cycles=1, time_step=0.002
    )
    assert len(walk.time) == 40
    assert len(hk.measures.per_cycle(walk).height) == 1
    with pytest.raises(InvalidInputError, match="max_cycles"):
        hk.simulate(athena, hk.terrain.Plane(), hk.PostureController(athena), max_cycles=0)


def test_the_force_that_the_controller_reads_is_chosen_by_name(athena):
    with pytest.raises(UnknownNameError, match="force_sampling"):
        hk.simulate(athena, hk.terrain.Plane(), hk.PostureController(athena), force_sampling="first")


@pytest.mark.parametrize("error", [metadata.PackageNotFoundError("numpy"), ValueError("the metadata is damaged")])
def test_a_walk_is_kept_where_a_version_cannot_be_read(athena, monkeypatch, error):
    def unreadable(name):
        raise error

    monkeypatch.setattr(metadata, "version", unreadable)
    walk = hk.simulate(athena, hk.terrain.Plane(), hk.PostureController(athena), duration=0.1, settling_time=0.1)
    assert set(walk.parameters["versions"]) == {"python", "hexakin"}


@pytest.mark.parametrize("engine", ["pybullet", "rigid", "mujoco"])
def test_progress_is_shown_on_stderr_and_changes_nothing(athena, capfd, engine):
    def walk(**options):
        controller = hk.PostureController(athena)
        return hk.simulate(athena, hk.terrain.Plane(), controller, engine=engine, time_step=0.005, **options)

    silent = walk(duration=0.5)  # the first walk may say that it compiles
    capfd.readouterr()
    assert np.array_equal(walk(duration=0.5).q, silent.q) and capfd.readouterr() == ("", "")
    shown = walk(duration=0.5, progress=True)
    out, err = capfd.readouterr()
    assert out == "" and err.startswith("\rathena:   0%") and "10/10" in err and err.endswith("\n")
    assert repr(silent.parameters) == repr(shown.parameters)
    for name, values in silent.columns.items():
        assert np.array_equal(values, shown.columns[name], equal_nan=True), name


def test_progress_ends_with_a_walk_that_fails(athena, monkeypatch, capfd):
    monkeypatch.setitem(hk.engines.ENGINES, "overturned", (__name__, "Overturned"))
    with pytest.raises(SimulationError, match="no ground below the torso"):
        hk.simulate(
            athena, hk.terrain.Plane(), hk.PostureController(athena), engine="overturned", duration=9.0, progress=True
        )
    assert capfd.readouterr().err.splitlines()[-1].startswith("athena:   0%|")
