"""Valid arguments of every public callable: the starting point of every wrong input.

A class in ``INSTANCES`` has an example; its constructor's arguments are the fields of this example, and its methods
are called on it. All other arguments come from ``ARGUMENTS``, by ``callable.argument`` or else by the argument's name.
Arguments with a default keep it, unless one is listed here. ``arguments_of`` raises LookupError for an argument without
an example, so that a new public function must get one.
"""

import tempfile
from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import hexakin as hk
from hexakin import feasibility, stance
from hexakin.checks import Array
from hexakin.contact.problem import ContactProblem
from hexakin.control.steering import SteeringController, Twist
from hexakin.motion.motion import Motion
from hexakin.papers import statements
from hexakin.terrain import Plane
from hexakin.transforms import pose

matplotlib.use("agg")

CURVES = np.linspace(-1.0, 1.0, 9)
ENGINE = {"time_step": 0.005, "friction": 0.9, "restitution": 0.5}


@cache
def folder() -> Path:
    """A folder for what the examples read and write."""
    return Path(tempfile.mkdtemp(prefix="wrong-inputs-"))


@cache
def robot() -> hk.Robot:
    return hk.load_robot("athena")


@cache
def body() -> Array:
    return pose(np.eye(3), [0.0, 0.0, hk.kinematics.standing_height(robot())])


@cache
def feet() -> Array:
    return hk.forward_kinematics(robot(), robot().standing_q)


def carrying() -> Array:
    return np.ones(6, dtype=bool)


@cache
def controller() -> hk.PostureController:
    return hk.PostureController(robot(), phase_duration=0.2)


@cache
def recording() -> hk.Recording:
    return hk.simulate(robot(), Plane(), controller(), engine="rigid", duration=1.0, time_step=0.005)


@cache
def saved() -> Path:
    recording().save(folder() / "walk.npz")
    return folder() / "walk.npz"


@cache
def plan() -> hk.WalkPlan:
    return hk.plan_walk(hk.load_robot("hwr"), Plane(), num_steps=2, samples_per_step=10)


@cache
def motion() -> Motion:
    return feasibility.commanded_walk(controller(), Plane(), num_cycles=1)


@cache
def report() -> feasibility.FeasibilityReport:
    return feasibility.check(robot(), motion(), Plane())


@cache
def contacts() -> stance.Contacts:
    return stance.contacts_of(robot(), body(), robot().standing_q, carrying(), Plane())


@cache
def problem() -> ContactProblem:
    configuration = hk.dynamics.configuration(robot(), body(), robot().standing_q)
    jacobian = hk.dynamics.foot_jacobians(robot(), configuration).reshape(-1, 24)
    mass = hk.dynamics.mass_matrix(robot(), configuration)
    return ContactProblem(mass, np.full(24, -0.01), jacobian[:, :])


@cache
def observation() -> hk.Observation:
    return hk.Observation.at_rest(0.0, robot().standing_q, np.full(6, robot().weight / 6), float(body()[2, 3]))


@cache
def steering() -> SteeringController:
    return (
        SteeringController(robot(), Twist(forward=0.02), phase_duration=0.2)
        if False
        else SteeringController(robot(), Twist(forward=0.02))
    )


@cache
def verdict_table():
    return statements.verdicts(runs())


@cache
def runs():
    from hexakin.papers.results import results

    return results("ramp_sweeps")


def axes(*, projection: str | None = None):
    return Figure(figsize=(2.0, 2.0)).add_subplot(projection=projection)


def curve(*arguments: Array) -> Array:
    return 0.01 * np.sin(sum(arguments))


def trial(a: int) -> dict[str, float]:
    """A study's trial."""
    return {"b": float(a)}


@cache
def study() -> hk.study.Study:
    return hk.study.Study("example", trial, tuple(hk.study.grid(a=[1, 2])))


INSTANCES = {}
ARGUMENTS = {}
