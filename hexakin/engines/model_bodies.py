"""The bodies of a Pinocchio model, for the rigid engine's own dynamics.

This is a module of its own so that a change of the robot does not make the machine code of the dynamics invalid.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.dynamics import pin
from hexakin.engines.leg_dynamics import Bodies
from hexakin.exceptions import InvalidInputError

_UPPER = np.triu_indices(3)  # xx, xy, xz, yy, yz, zz


def bodies_of(model: pin.Model) -> Bodies:
    """Return the bodies of a Pinocchio model.

    Raises InvalidInputError for a joint that is neither free, without a body before it, nor a hinge about z in a chain.
    """
    base_q: list[int] = []
    base_v: list[int] = []
    base_inertia: list[list[float]] = []
    legs: list[list[int]] = []
    base_of: dict[int, int] = {}
    for joint in range(1, model.njoints):
        kind, parent = model.joints[joint], model.parents[joint]
        if kind.shortname() == "JointModelFreeFlyer" and parent == 0:
            base_of[joint] = len(base_q)
            base_q.append(kind.idx_q)
            base_v.append(kind.idx_v)
            inertia = model.inertias[joint]
            first = inertia.mass * inertia.lever
            second = inertia.inertia - inertia.mass * _skew(inertia.lever) @ _skew(inertia.lever)
            base_inertia.append([inertia.mass, *first, *second[_UPPER]])
        elif kind.shortname() == "JointModelRZ" and parent in base_of:
            legs.append([joint])
        elif kind.shortname() == "JointModelRZ" and parent > 0 and (chain := [x for x in legs if x[-1] == parent]):
            chain[0].append(joint)
        else:
            raise InvalidInputError(
                f"model: joint {model.names[joint]!r} is neither a free body nor a hinge about z of a leg"
            )
    joints = [joint for leg in legs for joint in leg]
    starts = np.cumsum([0] + [len(leg) for leg in legs])
    inertias = [model.inertias[joint] for joint in joints]
    places = [model.jointPlacements[joint] for joint in joints]
    return Bodies(
        base_q=np.array(base_q, dtype=np.int64),
        base_v=np.array(base_v, dtype=np.int64),
        joint_q=np.array([model.joints[joint].idx_q for joint in joints], dtype=np.int64),
        joint_v=np.array([model.joints[joint].idx_v for joint in joints], dtype=np.int64),
        leg_base=np.array([base_of[model.parents[leg[0]]] for leg in legs], dtype=np.int64),
        leg_start=starts.astype(np.int64),
        base_inertia=np.array(base_inertia).reshape(-1, 10),
        segment_inertia=np.array([[i.mass, *i.lever, *i.inertia[np.triu_indices(3)]] for i in inertias]).reshape(
            -1, 10
        ),
        placement=np.array([[*place.rotation.ravel(), *place.translation] for place in places]).reshape(-1, 12),
        gravity=np.array(model.gravity.linear),
    )


def _skew(a: Array) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
