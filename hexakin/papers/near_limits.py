"""Walks up ramps near the limits of the robot: predictions before the walk, and the outcome of the simulation.

The trial ``near_limit`` checks a commanded walk and simulates it. ``foresight`` reports how often each predicted margin
(of ``hexakin.feasibility``, ``hexakin.stance`` and ``hexakin.support_region``) was right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.stats import mannwhitneyu, qmc

from hexakin.control.posture import PostureController
from hexakin.exceptions import InvalidInputError, SimulationError
from hexakin.feasibility import Motion, check, commanded_walk
from hexakin.feasibility.casadi_legs import leg_states
from hexakin.feasibility.forces import friction_needed
from hexakin.feasibility.statics import static_problem
from hexakin.motion.measures import slips
from hexakin.robot.file import load_robot
from hexakin.robot.model import Robot
from hexakin.simulation.closed_loop import simulate
from hexakin.stability.stance import contacts_of, energy_margin, longitudinal_margin, polygon_margin
from hexakin.stability.support_region import region_margin
from hexakin.study.runner import Study
from hexakin.study.tables import Scalar
from hexakin.terrain.base import Terrain
from hexakin.terrain.planes import Ramp
from hexakin.transforms import transform_points

RANGES = {"slope": (0.17, 0.79), "friction": (0.3, 1.2), "max_torque": (0.25, 1.89), "stride": (0.03, 0.065)}
"""Ranges of slope [rad], friction, torque limit [N m] and stride [m]; the logarithm of the torque limit is uniform."""

MARGINS = {
    "margin_polygon": "support polygon [m]",
    "margin_longitudinal": "longitudinal [m]",
    "margin_energy": "energy [m]",
    "margin_friction": "friction",
    "margin_torque": "torque [N m]",
    "margin_region": "support region [m]",
    "margin_region_torque": "support region with torque [m]",
}
"""Columns of predicted margins, each the smallest over the commanded walk, and their names.

The friction margin is the coefficient of friction minus the smallest coefficient that holds the robot."""

_EMPTY = -1.0  # [m] replaces the margin of an empty region


def study(*, runs: int = 200, on_pybullet: int = 60, seed: int = 0) -> Study:
    """Latin hypercube of ``runs`` walks over ``RANGES`` on the rigid engine, each from its own start.

    The first ``on_pybullet`` walks are made on PyBullet too; the rows of a hypercube are in random order. ``seed``
    draws the hypercube.
    """
    shares = qmc.LatinHypercube(len(RANGES), rng=seed).random(runs)
    points = []
    for k, share in enumerate(shares):
        point: dict[str, Scalar] = {}
        for (name, (low, high)), part in zip(RANGES.items(), share, strict=True):
            value = low * (high / low) ** part if name == "max_torque" else low + part * (high - low)
            point[name] = round(float(value), 6)
        points.append({**point, "seed": k})
    rigid = [{**point, "engine": "rigid"} for point in points]
    pybullet = [{**point, "engine": "pybullet"} for point in points[:on_pybullet]]
    return Study("ramp_limits", near_limit, (*rigid, *pybullet))


def near_limit(
    slope: float, friction: float, max_torque: float, stride: float, seed: int, engine: str, *,
    time_step: float = 0.002, num_cycles: int = 6,
) -> dict[str, float]:  # fmt: skip
    """Predict and then simulate ATHENA's walk up a ramp; a trial of ``hexakin.study``.

    ``slope`` [rad], ``friction``, ``max_torque`` [N m] and ``stride`` [m] are those of ``RANGES``, and ``seed`` draws
    the start. The columns of the result are:

    - the margins of ``MARGINS``, each the smallest over the commanded walk, and ``feasible`` (0 or 1) of
      ``feasibility.check``;
    - ``torso_contact``, the share of ticks in which the torso touched the ground (1 if the robot turned over or left
      the scene);
    - ``slip`` [m], the largest sliding distance among the feet in stance, as the median over the phases;
    - ``advance``, the distance uphill as a share of the commanded distance.
    """
    athena = load_robot("athena")
    robot = replace(athena, servo=replace(athena.servo, max_torque=max_torque))
    ramp, controller = Ramp(slope=slope), PostureController(robot, stride=stride, seed=seed)
    predicted = predict(robot, commanded_walk(controller, ramp, num_cycles=1), ramp, friction)
    try:
        recording = simulate(
            robot, ramp, controller, engine=engine, friction=friction, time_step=time_step, seed=seed,
            max_cycles=num_cycles, duration=2.0 * num_cycles * controller.phases_per_cycle,
        )  # fmt: skip
    except SimulationError:
        return {**predicted, "torso_contact": 1.0, "slip": float("nan"), "advance": 0.0}
    commanded = stride * controller.phases_per_cycle * num_cycles
    way = recording.T_world_body[-1, :3, 3] - recording.T_world_body[0, :3, 3]
    uphill = recording.T_world_body[0, :3, :3] @ robot.forward
    measured = {
        "torso_contact": float(np.mean(recording.torso_force > 0.0)),
        "slip": float(np.median(slips(recording))),
        "advance": float(way @ uphill) / commanded,
    }
    return {name: float(f"{value:.6g}") for name, value in {**predicted, **measured}.items()}


def predict(robot: Robot, motion: Motion, terrain: Terrain, friction: float) -> dict[str, float]:
    """Smallest margins over a motion, by the columns of ``MARGINS``, and ``feasible`` (0 or 1)."""
    report = check(robot, motion, terrain, friction=friction)
    least = {name: np.inf for name in MARGINS}
    least["margin_torque"] = float(np.nan_to_num(report.constraints["torque"].worst, nan=-robot.servo.max_torque))
    normals = terrain.normal(*np.moveaxis(transform_points(motion.T_world_body, motion.p_body_foot)[..., :2], -1, 0))
    problem = static_problem(
        robot, motion.T_world_body, leg_states(robot, motion.q), motion.carrying, normals,
        friction=friction, facets=16, torque_unit=robot.servo.max_torque,
    )  # fmt: skip
    least["margin_friction"] = max(friction - float(friction_needed(problem).max()), _EMPTY)
    forward = motion.T_world_body[0, :3, :3] @ robot.forward
    heading = float(np.arctan2(forward[1], forward[0]))
    changes = np.flatnonzero((motion.carrying[1:] != motion.carrying[:-1]).any(axis=1))
    ends = {0, *changes.tolist(), *(changes + 1).tolist(), len(motion.time) - 1}
    for k in range(len(motion.time)):
        place = (robot, motion.T_world_body[k], motion.q[k], motion.carrying[k], terrain)
        contacts = contacts_of(*place, friction=friction)
        found = {
            "margin_polygon": polygon_margin(contacts),
            "margin_longitudinal": longitudinal_margin(contacts, heading),
            "margin_energy": energy_margin(contacts).margin,
        }
        # Regions are slow to compute. The ends of the phases are enough: there the margins of a stroke are smallest.
        if k in ends:
            found["margin_region"] = region_margin(contacts, tolerance=1e-4)
            with_torque = contacts_of(*place, friction=friction, torque_limits=True)
            found["margin_region_torque"] = region_margin(with_torque, torque_limits=True, tolerance=1e-4)
        for name, value in found.items():
            least[name] = min(least[name], max(float(np.nan_to_num(value, nan=_EMPTY)), _EMPTY))
    return {**{name: float(value) for name, value in least.items()}, "feasible": float(report.feasible)}


def failures(table: pd.DataFrame, *, slip: float = 0.02, advance: float = 0.5) -> NDArray[np.bool_]:
    """Which walks failed, (n,) bool: the torso touched the ground, feet slid too far, or the advance was too small.

    ``table`` has one row per walk, with the columns of ``near_limit``. ``slip`` [m] is the largest allowed sliding
    distance, and ``advance`` the smallest allowed share of the commanded distance.
    """
    slid = ~(table["slip"] <= slip)
    return np.asarray((table["torso_contact"] > 0.0) | slid | (table["advance"] < advance))


def foresight(table: pd.DataFrame, failed: ArrayLike) -> pd.DataFrame:
    """How often each predicted margin was right: one row per margin, and one for ``feasible``.

    ``table`` has one row per walk, with the columns of ``near_limit``; ``failed`` (n,) bool marks the failed walks. A
    margin predicts success if it is at least zero, and failure otherwise. The columns of the result are:

    - ``right``, the share of walks with a right prediction;
    - ``missed``, the share of failed walks for which success was predicted;
    - ``false_alarms``, the share of successful walks for which failure was predicted;
    - ``ranked``, the probability that of a failed and a successful walk the failed one had the smaller margin (0.5 is
      chance).

    Raises InvalidInputError if no walk failed or none succeeded.
    """
    lost = np.asarray(failed, dtype=bool)
    if lost.all() or not lost.any():
        raise InvalidInputError(f"table: {lost.sum()} of {len(lost)} walks failed, expected some of each kind")
    rows: dict[str, Mapping[str, Any]] = {}
    for name in (*MARGINS, "feasible"):
        margin = table[name].to_numpy(dtype=float) - (0.5 if name == "feasible" else 0.0)
        warned = margin < 0.0
        rows[name] = {
            "right": np.mean(warned == lost),
            "missed": np.mean(~warned[lost]),
            "false_alarms": np.mean(warned[~lost]),
            "ranked": mannwhitneyu(margin[~lost], margin[lost]).statistic / (lost.sum() * (~lost).sum()),
        }
    return pd.DataFrame.from_dict(rows, orient="index")
