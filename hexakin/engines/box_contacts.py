"""Contacts between boxes, on faces, edges and corners, found by coal, the collision library of Pinocchio.

coal is based on FCL: J. Pan, S. Chitta and D. Manocha, "FCL: A general purpose library for collision and
proximity queries", 2012.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hexakin.checks import Array
from hexakin.dynamics import coal, pin
from hexakin.engines.ground_contacts import Contacts
from hexakin.engines.ground_grid import Ground
from hexakin.engines.shapes import Cuboid, Sphere
from hexakin.numerics.numba_cache import Whole, compiled

_FLUSH = 1e-3  # [m] depth below the deepest point up to which points belong to the contact patch


class _PosedBox(NamedTuple):
    box: coal.Box
    pose: coal.Transform3s
    rotation: Array
    center: Array
    half: Array


def _posed(box: coal.Box, rotation: Array, center: Array) -> _PosedBox:
    half = np.array(box.halfSide)
    return _PosedBox(box, coal.Transform3s(rotation, center), np.ascontiguousarray(rotation), center.copy(), half)


class BoxTouch:
    """Search for contacts of the boxes of bodies with boxes of the ground and with each other.

    ``model``, ``shapes`` and ``ground`` are those of ``MoreauStepper``. ``body_pairs`` are the pairs of boxes that can
    meet because their bodies move independently; boxes of the same robot do not collide.
    """

    def __init__(self, model: pin.Model, shapes: tuple[Sphere | Cuboid, ...], ground: Ground):
        self._cuboids = [shape for shape in shapes if isinstance(shape, Cuboid)]
        self._placements = [pin.SE3(np.array(cuboid.placement)) for cuboid in self._cuboids]
        self._boxes = [coal.Box(*(float(size) for size in cuboid.size)) for cuboid in self._cuboids]
        self._ground = [_posed(coal.Box(*(B[3:] - B[:3])), np.eye(3), 0.5 * (B[3:] + B[:3])) for B in ground.boxes]
        roots = [_root(model, cuboid.joint) for cuboid in self._cuboids]
        count = len(roots)
        self.body_pairs = [(b, a) for a in range(count) for b in range(a + 1, count) if roots[a] != roots[b]]
        self._request, self._result = coal.CollisionRequest(), coal.CollisionResult()
        self._patch_request = coal.ContactPatchRequest()
        self._patch_request.setPatchTolerance(_FLUSH)
        self._patches = coal.ContactPatchResult(self._patch_request)

    def add(self, poses: Array, pairs: Whole, margin: float, contacts: Contacts, count: int) -> int:
        """Append contacts to ``contacts``, which holds ``count`` of them, and return the new number.

        They are the contacts of ``pairs`` (k, 2), which are numbers of a body's box and of a box of the ground, and of
        the bodies with each other, with gaps of up to ``margin`` [m]. ``poses`` (joints, 12) are those of the bodies.
        """
        self._request.security_margin = margin
        posed: dict[int, _PosedBox] = {}

        def box(k: int) -> _PosedBox:
            if k not in posed:
                P = poses[self._cuboids[k].joint]
                T = pin.SE3(P[:9].reshape(3, 3).T, P[9:]) * self._placements[k]
                posed[k] = _posed(self._boxes[k], T.rotation, T.translation)
            return posed[k]

        for k, item in pairs.tolist():
            count = self._touch(self._cuboids[k], None, box(k), self._ground[item], contacts, count)
        for k, other in self.body_pairs:
            count = self._touch(self._cuboids[k], self._cuboids[other], box(k), box(other), contacts, count)
        return count

    def _touch(
        self, mine: Cuboid, other: Cuboid | None, box: _PosedBox, second: _PosedBox, contacts: Contacts, count: int
    ) -> int:
        self._result.clear()
        if not coal.collide(box.box, box.pose, second.box, second.pose, self._request, self._result):
            return count
        self._patches.clear()
        coal.computeContactPatch(
            box.box, box.pose, second.box, second.pose, self._result, self._patch_request, self._patches
        )
        for index in range(self._patches.numContactPatches()):
            patch = self._patches.getContactPatch(index)
            normal, depth = patch.getNormal(), patch.penetration_depth
            for corner in range(patch.size()):
                point = patch.getPoint(corner)
                gap = _gap(point, normal, *box[2:], *second[2:], depth)
                if count == contacts.gap.size or gap > self._request.security_margin:
                    continue
                contacts.bodies[count] = mine.joint, other.joint if other else -1
                contacts.point[count], contacts.normal[count] = point, -normal
                contacts.gap[count], contacts.group[count] = gap, mine.group
                contacts.key[count] = -1
                count += 1
        return count


@compiled
def _gap(
    point: Array, normal: Array, R: Array, x: Array, half: Array, R_other: Array, x_other: Array, half_other: Array,
    otherwise: float,
) -> float:  # fmt: skip
    """Gap [m] between two boxes on the line through a point, along the ``normal`` from the first to the second.

    The result is ``otherwise`` if the line misses one of the boxes or if the gap is smaller than that.
    """
    reach = np.empty(2)
    for k in range(2):
        rotation, center, size, side = (R, x, half, 1.0) if k == 0 else (R_other, x_other, half_other, -1.0)
        start, along = np.empty(3), np.empty(3)
        for a in range(3):
            start[a], along[a] = 0.0, 0.0
            for b in range(3):
                start[a] += rotation[b, a] * (point[b] - center[b])
                along[a] += side * rotation[b, a] * normal[b]
        # The line leaves a box where it first leaves one of its three slabs. Slabs parallel to the line are ignored.
        leave = np.inf
        for a in range(3):
            if abs(along[a]) > 1e-9:
                leave = min(leave, (np.copysign(size[a], along[a]) - start[a]) / along[a])
        for a in range(3):
            if abs(start[a] + leave * along[a]) > size[a] + 1e-6:
                return otherwise  # the line misses the box
        reach[k] = side * leave
    return max(reach[1] - reach[0], otherwise)


def _root(model: pin.Model, joint: int) -> int:
    while model.parents[joint] != 0:
        joint = model.parents[joint]
    return joint
