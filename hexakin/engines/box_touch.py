"""Contacts of boxes with boxes, edges and corners included, found by coal (Pinocchio's collision library)."""

from __future__ import annotations

import numpy as np

from hexakin.compiled import Whole
from hexakin.dynamics import coal, pin
from hexakin.engines.collision import Contacts, Ground
from hexakin.engines.shapes import Cuboid, Sphere

_FLUSH = 1e-5  # [m] how far from the deepest point two boxes count as touching


class BoxTouch:
    """The boxes of bodies against those of the ground and against each other.

    ``body_pairs`` are the boxes that can meet because they float independently; those of one robot do not collide.
    """

    def __init__(self, model: pin.Model, shapes: tuple[Sphere | Cuboid, ...], ground: Ground):
        self._cuboids = [shape for shape in shapes if isinstance(shape, Cuboid)]
        self._placements = [pin.SE3(np.array(cuboid.placement)) for cuboid in self._cuboids]
        self._boxes = [coal.Box(*(float(size) for size in cuboid.size)) for cuboid in self._cuboids]
        self._ground = [
            (coal.Box(*(B[3:] - B[:3])), coal.Transform3s(np.eye(3), 0.5 * (B[3:] + B[:3]))) for B in ground.boxes
        ]
        roots = [_root(model, cuboid.joint) for cuboid in self._cuboids]
        count = len(roots)
        self.body_pairs = [(b, a) for a in range(count) for b in range(a + 1, count) if roots[a] != roots[b]]
        self._request, self._result = coal.CollisionRequest(), coal.CollisionResult()
        self._patch_request = coal.ContactPatchRequest()
        self._patch_request.setPatchTolerance(_FLUSH)
        self._patches = coal.ContactPatchResult(self._patch_request)

    def add(self, data: pin.Data, pairs: Whole, margin: float, contacts: Contacts, count: int) -> int:
        """Append the contacts of ``pairs`` (body's box, ground's box) and of bodies' boxes; returns the new count."""
        self._request.security_margin = margin
        posed: dict[int, tuple[coal.Box, coal.Transform3s]] = {}

        def box(k: int) -> tuple[coal.Box, coal.Transform3s]:
            if k not in posed:
                T = data.oMi[self._cuboids[k].joint] * self._placements[k]
                posed[k] = self._boxes[k], coal.Transform3s(T.rotation, T.translation)
            return posed[k]

        for k, item in pairs.tolist():
            count = self._touch(self._cuboids[k], None, box(k), self._ground[item], contacts, count)
        for k, other in self.body_pairs:
            count = self._touch(self._cuboids[k], self._cuboids[other], box(k), box(other), contacts, count)
        return count

    def _touch(
        self,
        mine: Cuboid,
        other: Cuboid | None,
        posed: tuple[coal.Box, coal.Transform3s],
        other_posed: tuple[coal.Box, coal.Transform3s],
        contacts: Contacts,
        count: int,
    ) -> int:
        self._result.clear()
        if not coal.collide(*posed, *other_posed, self._request, self._result):
            return count
        self._patches.clear()
        coal.computeContactPatch(*posed, *other_posed, self._result, self._patch_request, self._patches)
        for index in range(self._patches.numContactPatches()):
            patch = self._patches.getContactPatch(index)
            for corner in range(min(patch.size(), contacts.gap.size - count)):
                contacts.bodies[count] = mine.joint, other.joint if other else -1
                contacts.point[count] = patch.getPoint(corner)
                contacts.normal[count] = -patch.getNormal()
                contacts.gap[count], contacts.group[count] = patch.penetration_depth, mine.group
                contacts.key[count] = -1
                count += 1
        return count


def _root(model: pin.Model, joint: int) -> int:
    while model.parents[joint] != 0:
        joint = model.parents[joint]
    return joint
