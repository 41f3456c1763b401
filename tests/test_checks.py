"""Checks of poses, and the functions that receive poses."""

from typing import Any, TypeVar

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from typing_extensions import TypeAliasType

import hexakin as hk
from hexakin.checks import check_columns, check_flags, check_poses, check_same_length, check_shape, checked
from hexakin.exceptions import InvalidInputError
from hexakin.figures import draw_wireframe
from hexakin.transforms import pose

GOOD = pose(Rotation.from_euler("xyz", [0.3, -0.2, 1.0]).as_matrix(), [0.1, 0.2, 0.3])


def changed(block=None, row=None):
    T = GOOD.copy()
    if block is not None:
        T[:3, :3] = block
    if row is not None:
        T[3] = row
    return T


WRONG = {
    "zeros": (np.zeros((4, 4)), "the first three rows and columns are no rotation"),
    "shear": (changed([[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]), "no rotation"),
    "scale": (changed(2.0 * np.eye(3)), "no rotation"),
    "reflection": (changed(np.diag([1.0, 1.0, -1.0])), "no rotation"),
    "huge": (changed(np.full((3, 3), 1e200)), "no rotation"),
    "last row": (changed(row=[0.0, 0.0, 1.0, 1.0]), r"the last row is not \(0, 0, 0, 1\)"),
    "transposed": (GOOD.T, "T_world_body: expected poses"),
    "nan": (np.full((4, 4), np.nan), "is nan, expected a finite number"),
    "3 x 3": (np.eye(3), r"expected shape \((..., )?4, 4\)"),
}


def test_poses_in_double_and_single_precision_and_long_products_are_poses():
    many = np.array([pose(Rotation.random(random_state=seed).as_matrix(), [seed, 0, 0]) for seed in range(100)])
    np.testing.assert_array_equal(check_poses("T", many), many)
    check_poses("T", many.astype(np.float32))
    check_poses("T", np.linalg.matrix_power(GOOD, 100000))


def test_the_index_of_the_first_wrong_pose_is_named():
    with pytest.raises(InvalidInputError, match=r"T: expected poses, .* no rotation \(at index 1, 2\)"):
        check_poses("T", [[GOOD] * 3, [GOOD, GOOD, 2 * GOOD]])


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_no_pose_is_refused_wherever_a_pose_is_received(athena, kind):
    wrong, message = WRONG[kind]
    q, stance, ground = athena.standing_q, np.ones(6, dtype=bool), hk.terrain.Plane()
    feet = hk.forward_kinematics(athena, q)
    import matplotlib.pyplot as plt

    figure = plt.figure()
    for receive in (
        lambda T: check_poses("T_world_body", T),
        lambda T: hk.kinematics.posed_inverse_kinematics(athena, T, feet),
        lambda T: hk.dynamics.configuration(athena, T, q),
        lambda T: hk.feasibility.distribute(athena, T, q, stance),
        lambda T: hk.stance.contacts_of(athena, T, q, stance, ground),
        lambda T: hk.clearance.torso_gaps(athena, ground, T),
        lambda T: draw_wireframe(figure.add_subplot(projection="3d"), athena, q, T),
    ):
        with pytest.raises(InvalidInputError, match=message):
            receive(wrong)
    plt.close(figure)


def test_a_motion_whose_times_run_backwards_is_not_checked(athena):
    ground = hk.terrain.Plane()
    walk = hk.simulate(athena, ground, hk.PostureController(athena), engine="rigid", duration=0.2, time_step=0.002)
    columns = {name: values for name, values in walk.columns.items() if name not in walk.diagnostics}
    back = hk.Recording(**columns | {"time": walk.time[::-1]}, parameters=walk.parameters)
    with pytest.raises(InvalidInputError, match=r"motion: time must ascend, but 0.1 s follows 0.15 s \(index 1\)"):
        hk.feasibility.check(athena, back, ground)


def test_flags_are_true_false_or_the_numbers_of_a_table():
    for flags in ([True, False], [1, 0], np.array([1.0, 0.0])):
        np.testing.assert_array_equal(check_flags("feasible", flags, (2,)), [True, False])
    for wrong in (["True", "False"], [2, 0], [0.5, 0.0], [float("nan"), 0.0]):
        with pytest.raises(InvalidInputError, match="feasible: expected"):
            check_flags("feasible", wrong, (2,))


def test_a_shape_holds_for_all_axes():
    assert check_shape("q", [[1, 2, 3]], (None, 3)).shape == (1, 3)
    for wrong in (1.0, [1.0, 2.0, 3.0], np.zeros((1, 1, 3)), np.zeros((1, 4))):
        with pytest.raises(InvalidInputError, match=r"q: expected shape \(n, 3\), got"):
            check_shape("q", wrong, (None, 3))
    with pytest.raises(InvalidInputError, match=r"limits: expected shape \(2,\), got \(3,\)"):
        check_shape("limits", [1.0, 2.0, 3.0], (2,))


def test_arguments_of_different_lengths_are_named():
    assert check_same_length(labels=["a", "b"], colours=("red", "blue")) == 2
    with pytest.raises(InvalidInputError, match="labels, colours: 1, 2 values, expected equally many"):
        check_same_length(labels=["a"], colours=("red", "blue"))


def test_columns_that_a_table_lacks_are_named():
    table = pd.DataFrame({"seed": [0], "status": ["ok"]})
    check_columns("runs", table, ["seed", "status"])
    with pytest.raises(InvalidInputError, match="runs: missing columns engine, layout"):
        check_columns("runs", table, ["engine", "seed", "layout", "engine"])


def test_an_alias_of_an_array_type_is_checked_like_the_type():
    """``numpy.typing.NDArray`` is such an alias since NumPy 2.5, which Python 3.12 and later get."""
    element = TypeVar("element", bound=np.generic)
    alias = TypeAliasType("alias", np.ndarray[tuple[Any, ...], np.dtype[element]], type_params=(element,))

    def count(flags, sizes=None):
        return len(flags)

    count.__annotations__ = {"flags": alias[np.bool_], "sizes": alias[np.floating] | None}
    counted = checked(count)
    assert counted(np.ones(3, dtype=bool), np.ones(3)) == 3
    with pytest.raises(InvalidInputError, match="flags: expected an array of True and False, got "):
        counted(np.ones(3))
    with pytest.raises(InvalidInputError, match="sizes: expected an array of numbers or None, got 'large'"):
        counted(np.ones(3, dtype=bool), "large")
