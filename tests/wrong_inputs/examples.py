"""Valid arguments of every public callable: the starting point of every wrong input.

A class in ``INSTANCES`` has an example; its constructor's arguments are the fields of this example, and its methods
are called on it. All other arguments come from ``ARGUMENTS``, by ``callable.argument`` or else by the argument's name.
Arguments with a default keep it, unless one is listed here. ``call_of`` raises LookupError for an argument without
an example, so that a new public function must get one.
"""

import functools
import inspect
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import sympy
from matplotlib.figure import Figure
from public_objects import public_objects

import hexakin as hk
from hexakin import contact, feasibility, paper, stability, stance, support_region, symbolic
from hexakin.animation import Animation
from hexakin.checks import Array
from hexakin.contact import ContactProblem, ContactSolution, Residuals
from hexakin.control.interface import Command, Controller, ControlRun, Observation
from hexakin.control.posture import PostureController, PostureRun
from hexakin.control.steering import SteeringController, SteeringRun, Twist
from hexakin.dynamics import Energies, MaximalModel
from hexakin.engines import Engine, Reading, TorqueLaw, engine_class
from hexakin.feasibility import Constraint, Design, FeasibilityReport, ForceDistribution, Motion
from hexakin.figures.sliders import Posture, Sliders
from hexakin.kinematics import InverseSolution
from hexakin.motion.measures import CycleMeasures, Quartiles
from hexakin.motion.recording import Recording
from hexakin.motion.walk_plan import WalkPlan
from hexakin.papers import scenarios, statements
from hexakin.papers.results import load_results
from hexakin.papers.scenarios import Scenario
from hexakin.papers.verdicts import Statement, Verdict
from hexakin.robot.model import Robot
from hexakin.stability import ZMP, StabilitySeries
from hexakin.stability.stance import EnergyMargin, PlaneZMP
from hexakin.stability.support_region import Support, SupportRegion
from hexakin.study import Study
from hexakin.symbolic import InverseExpressions, LegKinematics
from hexakin.terrain import Blocks, Box, HalfSpace, HeightField, LegCurves, Plane, Ramp, Terrain, TriangleMesh
from hexakin.transforms import pose
from hexakin.walking.gait import Gait, tripod
from hexakin.walking.planner import WalkReport
from hexakin.walking.swing import StepGeometry

matplotlib.use("agg")

OBJECTS = public_objects()
GRID = np.linspace(-1.0, 1.0, 9)
MEASURES = ("height", "pitch_rate", "roll_rate")
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
def elevation() -> Path:
    np.savez(folder() / "ground.npz", x=GRID, y=GRID, z=np.zeros((9, 9)))
    return folder() / "ground.npz"


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
    jacobian = hk.dynamics.foot_jacobians(robot(), configuration())
    return ContactProblem(hk.dynamics.mass_matrix(robot(), configuration()), np.full(24, -0.01), jacobian)


@cache
def observation() -> hk.Observation:
    return hk.Observation.at_rest(0.0, robot().standing_q, np.full(6, robot().weight / 6), float(body()[2, 3]))


@cache
def steering() -> SteeringController:
    return SteeringController(robot(), Twist(forward=0.02))


@cache
def runs() -> pd.DataFrame:
    both = load_results("ramp_sweeps")[0]
    return both[both["engine"] == "rigid"]


@cache
def judged() -> pd.DataFrame:
    return statements.verdicts(runs())


@cache
def statement() -> Statement:
    return next(iter(statements.statements().values()))


@cache
def leg_kinematics() -> LegKinematics:
    return symbolic.derive(robot().table)


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


def engine() -> Engine:
    simulator = engine_class("rigid")(robot(), Plane(), **ENGINE)
    simulator.place(body(), robot().standing_q)
    return simulator


INSTANCES = {
    Animation: lambda: hk.animation.animate(robot(), motion(), Plane()),
    Blocks: Blocks,
    Box: lambda: Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    Command: lambda: controller().start(observation(), 20.0).command(observation()),
    Constraint: lambda: next(iter(report().constraints.values())),
    ContactProblem: problem,
    ContactSolution: lambda: contact.solve(problem()),
    CycleMeasures: lambda: hk.measures.per_cycle(recording()),
    Design: lambda: Design(0.1, ("reach",), {"stride": 0.1}, True),
    Energies: lambda: hk.dynamics.energies(robot(), configuration(), np.zeros(24)),
    EnergyMargin: lambda: stance.energy_margin(contacts()),
    Engine: engine,
    FeasibilityReport: report,
    ForceDistribution: lambda: report().forces,
    Gait: lambda: tripod(robot()),
    HalfSpace: lambda: HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    HeightField: lambda: HeightField(GRID, GRID, np.zeros((9, 9))),
    InverseExpressions: lambda: leg_kinematics().inverse,
    InverseSolution: lambda: hk.inverse_kinematics(robot(), feet()),
    LegCurves: lambda: LegCurves(curve, curve),
    LegKinematics: leg_kinematics,
    MaximalModel: lambda: hk.dynamics.maximal_model(robot(), configuration()),
    Motion: motion,
    Observation: observation,
    Plane: Plane,
    PlaneZMP: lambda: stance.zmp_on_plane(contacts().points, np.tile([0.0, 0.0, 5.0], (6, 1)), [0, 0, 0], [0, 0, 1]),
    PostureController: controller,
    PostureRun: lambda: controller().start(observation(), 20.0),
    Posture: lambda: hk.sliders.posture_of_leg(robot(), 1, [0.0, 0.1, 0.2]),
    Quartiles: lambda: hk.measures.quartiles([1.0, 2.0, 3.0]),
    Ramp: Ramp,
    Reading: lambda: engine().advance(robot().standing_q, 1),
    Recording: recording,
    Residuals: lambda: contact.solve(problem()).residuals,
    Robot: robot,
    SteeringController: steering,
    SteeringRun: lambda: steering().start(observation(), 20.0),
    Scenario: lambda: scenarios.SCENARIOS["ramp"],
    Sliders: lambda: hk.sliders.leg_angles(robot()),
    StabilitySeries: lambda: stability.series(recording()),
    Statement: statement,
    stance.Contacts: contacts,
    StepGeometry: lambda: hk.swing.step_geometry([0.0, 0.0, 0.0], [0.1, 0.0, 0.02]),
    Study: study,
    Support: lambda: support_region.support(contacts(), [1.0, 0.0]),
    SupportRegion: lambda: support_region.support_region(contacts()),
    TorqueLaw: lambda: TorqueLaw(np.zeros((6, 3)), np.zeros((6, 3)), np.zeros((6, 3))),
    TriangleMesh: lambda: TriangleMesh(np.eye(3), np.array([[0, 1, 2]])),
    Twist: lambda: Twist(forward=0.02),
    Verdict: lambda: paper.judge(statement(), runs()),
    WalkPlan: plan,
    WalkReport: lambda: hk.walker.check_plan(hwr(), plan()),
    ZMP: lambda: stability.zmp(recording()),
}
"""An example of each public class; classes that are missing here are protocols, or have no arguments."""

ARGUMENTS = {
    "T": body,
    "T_target_source": body,
    "T_world_body": body,
    "a": lambda: [0.0, 0.0, 1.0],
    "acceleration": lambda: np.zeros(24),
    "after": lambda: [1.0, 2.0],
    "angle": lambda: 0.1,
    "angles": lambda: [0.0, 0.1, 0.2],
    "apex": lambda: 0.03,
    "arguments": lambda: sympy.symbols("u v"),
    "arrows": lambda: [("one", "two", "")],
    "ax": lambda: axes(),
    "axes": lambda: [axes(), axes()],
    "axis": lambda: [0.0, 0.0, 1.0],
    "b": lambda: [1.0, 0.0, 0.0],
    "before": lambda: [1.0, 3.0],
    "carrying": carrying,
    "colours": lambda: ["red", "blue"],
    "configuration": lambda: configuration(),
    "contacts": contacts,
    "control": lambda: np.zeros((4, 3)),
    "control_rate": lambda: 20.0,
    "controller": controller,
    "count": lambda: 2,
    "cycle": lambda: [0.1, 0.6],
    "direction": lambda: [0.0, 0.0, -1.0],
    "displacement": lambda: [0.05, 0.0, 0.0],
    "end": lambda: [0.1, 0.0, 0.02],
    "engine": lambda: "rigid",
    "error": lambda: ValueError("example"),
    "expressions": lambda: list(sympy.symbols("u v")),
    "feasible": lambda: [True, False],
    "feet": lambda: feet()[:, :2],
    "figure": lambda: Figure(figsize=(2.0, 2.0)),
    "foot_force": lambda: np.full(6, 5.0),
    "force": lambda: np.tile([0.0, 0.0, 5.0], (6, 1)),
    "forces": lambda: np.tile([0.0, 0.0, 5.0], (6, 1)),
    "forward": lambda: [0.0, 1.0, 0.0],
    "friction": lambda: 0.9,
    "functions": lambda: {"sin": np.sin},
    "gains": lambda: {"k_z": 0.8, "k_alpha": 0.6, "k_beta": 0.0},
    "gait": lambda: tripod(robot()),
    "gap": lambda: 0.001,
    "ground": Plane,
    "groups": lambda: [[0, 2, 4], [1, 3, 5]],
    "heading": lambda: 0.0,
    "height": lambda: 0.1,
    "high": lambda: [2.0, 2.0, 2.0],
    "home": feet,
    "jacobian": lambda: hk.jacobian(robot(), robot().standing_q),
    "joint": lambda: 1,
    "k_alpha": lambda: 0.6,
    "k_beta": lambda: 0.0,
    "k_z": lambda: 0.8,
    "label": lambda: "height [m]",
    "labels": lambda: ["one", "two"],
    "layout": lambda: 0,
    "leg": lambda: 1,
    "levels": lambda: [0.0, 1.0],
    "low": lambda: [0.0, 0.0, 0.0],
    "motion": motion,
    "name": lambda: "athena",
    "names": lambda: ["one", "two"],
    "normal": lambda: [0.0, 0.0, 1.0],
    "num_steps": lambda: 1,
    "observation": observation,
    "offset": lambda: [0.0, 0.0, 0.01],
    "origin": lambda: [0.0, 0.0, 1.0],
    "p": lambda: feet()[:, :2],
    "p_body_foot": feet,
    "p_foot": feet,
    "p_source": feet,
    "p_world_foot": lambda: feet() + body()[:3, 3],
    "path": lambda: folder() / "file",
    "phase": lambda: 0.5,
    "plan": plan,
    "point": lambda: [0.0, 0.0],
    "points": feet,
    "polygon": lambda: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
    "position": lambda: [0.0, 0.0, 0.1],
    "problem": problem,
    "q": lambda: robot().standing_q,
    "q_command": lambda: robot().standing_q,
    "recording": recording,
    "regions": lambda: {"one": [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]]},
    "robot": robot,
    "rotation": lambda: np.eye(3),
    "row": lambda: next(judged().itertuples()),
    "rpy": lambda: [0.0, 0.1, 0.0],
    "runs": runs,
    "s": lambda: [0.0, 0.1],
    "samples": lambda: [0, 5],
    "scale": lambda: 0.01,
    "scenario": lambda: "ramp",
    "seed": lambda: 0,
    "side": axes,
    "start": lambda: [0.0, 0.0, 0.0],
    "statement": statement,
    "steps": lambda: {"one": (0.0, 1.0, "One"), "two": (0.0, 0.0, "Two")},
    "stop": lambda: 2,
    "stride": lambda: 0.05,
    "study": study,
    "summaries": lambda: {"rigid": np.sort(np.random.default_rng(0).random((2, 3, 5)), axis=-1)},
    "table": runs,
    "terrain": Plane,
    "time": lambda: 0.0,
    "time_step": lambda: 0.005,
    "titles": lambda: ["one", "two"],
    "top": axes,
    "torque": lambda: np.zeros((6, 3)),
    "twist": lambda: Twist(forward=0.02),
    "values": lambda: [1.0, 2.0],
    "vector": lambda: [0.0, 0.0, 1.0],
    "velocity": lambda: np.zeros(24),
    "value": lambda: 1.0,
    "verdicts": judged,
    "x": lambda: [0.0, 0.1],
    "x_levels": lambda: [0.0, 1.0],
    "xlabel": lambda: "gain",
    "y": lambda: [0.0, 0.1],
    "y_levels": lambda: [0.0, 1.0],
    "ylabel": lambda: "height [m]",
}
"""Arguments by name. ``SPECIAL`` has those that a function needs otherwise, and short runs of long functions."""

SPECIAL = {
    "Animation.save.path": lambda: folder() / "walk.gif",
    "CycleMeasures.height": lambda: hk.measures.per_cycle(recording()).height,
    "Engine.place.q": lambda: robot().standing_q,
    "Gait.swinging.phase": lambda: 0,
    "LegKinematics.carried.point": lambda: [0.0, 0.0, 0.0],
    "LegKinematics.symbol.name": lambda: robot().table.parameters[0],
    "LegKinematics.transform.start": lambda: 0,
    "PostureController.stance_displacement.delta_alpha": lambda: 0.1,
    "PostureController.stance_displacement.delta_beta": lambda: 0.1,
    "PostureController.stance_displacement.delta_z": lambda: 0.01,
    "PostureController.swing_displacement.delta_z": lambda: 0.01,
    "Recording.save.path": lambda: folder() / "copy.npz",
    "bar_effects.high": lambda: [1.5, 2.5],
    "bar_effects.low": lambda: [0.5, 1.5],
    "box_groups.groups": lambda: [[[1.0, 2.0]], [[2.0, 3.0]]],
    "contact_jacobian.axes": lambda: hk.kinematics.joint_axes(robot(), robot().standing_q),
    "contact_jacobian.cross_lever": lambda: np.zeros((6, 3, 3)),
    "derive.table": lambda: robot().table,
    "draw_frame.ax": lambda: axes(projection="3d"),
    "draw_gait.names": lambda: [leg.name for leg in robot().legs],
    "draw_plan.ax": lambda: axes(projection="3d"),
    "draw_plan.robot": lambda: hwr(),
    "check_plan.robot": lambda: hwr(),
    "draw_plane.ax": lambda: axes(projection="3d"),
    "draw_plane.points": lambda: feet()[:3],
    "draw_regions.center_of_mass": lambda: [0.0, 0.0],
    "draw_forces.points": lambda: feet()[:, :2],
    "draw_forces.forces": lambda: np.ones((6, 2)),
    "draw_robot.ax": lambda: axes(projection="3d"),
    "draw_skeleton.ax": lambda: axes(projection="3d"),
    "draw_terrain.ax": lambda: axes(projection="3d"),
    "draw_terrain.high": lambda: (0.2, 0.2),
    "draw_terrain.low": lambda: (0.0, 0.0),
    "draw_wireframe.ax": lambda: axes(projection="3d"),
    "engine_class.name": lambda: "rigid",
    "five_columns.name": lambda: "height",
    "footholds_to_rise_on.ground": lambda: 0.0,
    "heat_map.values": lambda: [[1.0, 2.0], [3.0, 4.0]],
    "judge.runs": runs,
    "lies.height": lambda: 0.1,
    "load_recording.path": saved,
    "measure.num_cycles": lambda: 1,
    "reported.figure": lambda: "A10a",
    "save_pdf.path": lambda: folder() / "figure.pdf",
    "set_equal_3d.ax": lambda: axes(projection="3d"),
    "simulate.duration": lambda: 0.4,
    "simulate.engine": lambda: "rigid",
    "simulate.settling_time": lambda: 0.1,
    "simulate.time_step": lambda: 0.005,
    "simulate_walk.num_cycles": lambda: 1,
    "simulate_walk.time_step": lambda: 0.005,
    "run.folder": lambda: folder() / "results",
    "run.jobs": lambda: 1,
    "run.progress": lambda: False,
    "repeats.scenario": lambda: "ramp",
    "commanded_walk.num_cycles": lambda: 1,
    "plan_walk.num_steps": lambda: 2,
    "plan_walk.samples_per_step": lambda: 10,
    "plan_walk.robot": lambda: hwr(),
    "support.direction": lambda: [1.0, 0.0],
    "swing_control_points.forward": lambda: [0.0, 1.0, 0.0],
    "walk.num_cycles": lambda: 1,
    "way_to_ground.direction": lambda: np.array([0.0, 0.0, 1.0]),
    "LegCurves.displacement.s": lambda: np.zeros((2, 6)),
    "HeightField.from_file.path": elevation,
    "scenario_of.name": lambda: "ramp",
    "PostureRun.control_rate": lambda: 20.0,
    "PostureRun.observation": observation,
    "Sliders.posture": lambda: lambda values, q_before: hk.sliders.posture_of_leg(robot(), 1, values),
    "SteeringRun.control_rate": lambda: 20.0,
    "SteeringRun.observation": observation,
    "distribute.T_world_body": lambda: body()[None],
    "distribute.carrying": lambda: carrying()[None],
    "distribute.q": lambda: robot().standing_q[None],
    "draw_sweep.axes": lambda: [axes(), axes(), axes()],
    "draw_sweep.titles": lambda: ["one", "two", "three"],
    "draw_sweep.summaries": lambda: {
        m: {"rigid": np.sort(np.random.default_rng(0).random((2, 3, 5)))} for m in MEASURES
    },
    "forces_from_torques.T_world_body": lambda: body()[None],
    "forces_from_torques.q": lambda: robot().standing_q[None],
    "forces_from_torques.torque": lambda: np.zeros((1, 6, 3)),
    "internal_forces.carrying": lambda: carrying()[None],
    "internal_forces.force": lambda: np.ones((1, 6, 3)),
    "internal_forces.points": lambda: feet()[None],
    "path_inverse_kinematics.p_body_foot": lambda: feet()[None],
    "plot_leg_angles.q": lambda: np.tile(robot().standing_q[0], (2, 1)),
    "polygon_margins.carrying": lambda: carrying()[None],
    "polygon_margins.p_foot": lambda: feet()[None, :, :2],
    "polygon_margins.point": lambda: [[0.0, 0.0]],
    "torques_from_forces.T_world_body": lambda: body()[None],
    "torques_from_forces.force": lambda: np.zeros((1, 6, 3)),
    "torques_from_forces.q": lambda: robot().standing_q[None],
    "zmp_on_plane.origin": lambda: [0.0, 0.0, 0.0],
}


LONG = {
    f"{function}.{argument}": ("thousand", "in millimetres")
    for function, argument in (
        ("simulate", "duration"),
        ("simulate", "settling_time"),
        ("simulate_walk", "num_cycles"),
        ("commanded_walk", "num_cycles"),
        ("gain_grid", "count"),
    )
}
"""Calls that ask for long work, such as a walk of 1000 s; they are right, and are not made."""


@cache
def hwr() -> hk.Robot:
    return hk.load_robot("hwr")


@cache
def configuration() -> Array:
    return hk.dynamics.configuration(robot(), body(), robot().standing_q)


PROTOCOLS = {Controller: controller, ControlRun: INSTANCES[PostureRun], Terrain: Plane}
"""Examples of objects that follow a protocol, whose methods are called on them."""


def call_of(name: str) -> tuple[Callable[..., object], dict[str, Callable[[], object]]]:
    """The callable of a public name, bound to an example if it is a method, and the makers of its arguments."""
    public, owner = OBJECTS[name], OBJECTS.get(name.rpartition(".")[0])
    if inspect.isclass(public):
        if public not in INSTANCES:
            raise LookupError(f"{name}: INSTANCES has no example of this class")
        example = INSTANCES[public]()
        own = {
            p: SPECIAL.get(f"{public.__name__}.{p}", functools.partial(_field, example, p))
            for p in inspect.signature(public).parameters
        }
        return public, {p: maker for p, maker in own.items() if maker() is not None}
    if inspect.isclass(owner) and not inspect.ismethod(public):
        made = PROTOCOLS[owner]() if owner in PROTOCOLS else INSTANCES[owner]()
        public = getattr(made, public.__name__)
    makers = {}
    for parameter in inspect.signature(public).parameters.values():
        if parameter.kind is parameter.VAR_KEYWORD:
            own = f"{_short(name)}."
            makers |= {key.removeprefix(own): maker for key, maker in SPECIAL.items() if key.startswith(own)}
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        maker = SPECIAL.get(f"{_short(name)}.{parameter.name}")
        if maker is None and parameter.default is parameter.empty:
            maker = ARGUMENTS.get(parameter.name)
            if maker is None:
                raise LookupError(f"{name}: no example of the argument {parameter.name!r}")
        if maker is not None:
            makers[parameter.name] = maker
    return public, makers


def is_long(name: str, parameter: str, kind: str) -> bool:
    """Whether a call asks for long work; see ``LONG``."""
    return kind in LONG.get(f"{_short(name)}.{parameter}", ())


def parameters_of(name: str) -> list[str]:
    """The arguments of a public callable that a caller gives by name."""
    public = OBJECTS[name]
    found = inspect.signature(public).parameters.values()
    without = ("VAR_POSITIONAL", "VAR_KEYWORD", "POSITIONAL_ONLY")
    return [p.name for p in found if p.name != "self" and p.kind.name not in without]


def _field(example: object, name: str) -> object:
    """A constructor's argument, which the object keeps under the same name, perhaps as a private one."""
    return getattr(example, name, getattr(example, f"_{name}", None))


def _short(name: str) -> str:
    """The name without its module: ``function``, or ``Class.method``."""
    owner = OBJECTS.get(name.rpartition(".")[0])
    return ".".join(name.split(".")[-2 if inspect.isclass(owner) else -1 :])
