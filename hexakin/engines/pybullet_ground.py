"""A terrain in PyBullet: shapes as they are, and large height fields in tiles around the robot."""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.engines.pybullet_import import pybullet
from hexakin.terrain.base import Box, HalfSpace, Terrain, TriangleMesh
from hexakin.terrain.height_field import GridMesh

_MOST_POINTS = 50_000  # of a height field as one mesh. PyBullet refuses meshes of more than 87,000, and is slow before.
_TILE = 64  # cells along each side of a tile: larger ones take longer to make, smaller ones more time in each step
_AHEAD = 0.05  # [m] tiles are made this far around the robot
# [m] On a tile, points of a foot that are farther from the ground take no force. In small cells Bullet adds such points
# on the triangles around the one that is touched, up to 0.6 mm from it, and each costs the solver as much as a contact.
# Chosen as the largest round number below the distances of those points; walks stay the same (tests).
_FARTHEST_LOADED = 1e-4
# [m/s] Speed over the ground up to which no part of the robot leaves the tiles between two checks; assumed: several
# times the speed of walking robots' feet. A check takes a seventh of a step's time.
_FASTEST = 2.5


class BulletGround:
    """The ground of a robot's simulation in the physics server ``client``.

    A height field of up to 50,000 points is one triangle mesh, other triangle meshes too. Larger ones are height field
    shapes of 64 x 64 cells, which have the same triangles; they are made where the robot comes. There, points of
    contact that are more than 0.1 mm from the ground take no force.
    """

    def __init__(self, terrain: Terrain, client: int):
        self._client = client
        # Without another shape to draw, PyBullet would copy each shape for this purpose, which takes most of the time.
        self._drawn = pybullet.createVisualShape(pybullet.GEOM_SPHERE, radius=1e-3, physicsClientId=client)
        self._tiled: list[tuple[GridMesh, set[tuple[int, int]]]] = []
        for shape in terrain.shapes():
            if isinstance(shape, GridMesh) and shape.z.size > _MOST_POINTS:
                self._tiled.append((shape, set()))
            else:
                self._add(shape)

    def steps_between_checks(self, time_step: float) -> int:
        """Return after how many steps of ``time_step`` [s] ``reach`` is due; 0 if never."""
        return max(int(_AHEAD / _FASTEST / time_step), 1) if self._tiled else 0

    def reach(self, body: int) -> None:
        """Make the tiles below the robot ``body``, an index of PyBullet, and around it."""
        if not self._tiled:
            return
        links = range(-1, pybullet.getNumJoints(body, physicsClientId=self._client))
        boxes = np.array([pybullet.getAABB(body, link, physicsClientId=self._client) for link in links])
        low, high = boxes[:, 0].min(axis=0) - _AHEAD, boxes[:, 1].max(axis=0) + _AHEAD
        for field, made in self._tiled:
            (i0, i1), (j0, j1) = (_tiles(axis, low[k], high[k]) for k, axis in enumerate((field.x, field.y)))
            for tile in ((i, j) for i in range(i0, i1) for j in range(j0, j1)):
                if tile not in made:
                    made.add(tile)
                    self._add_tile(field, *tile)

    def _add_tile(self, field: GridMesh, i: int, j: int) -> None:
        x, y = field.x[i * _TILE : (i + 1) * _TILE + 1], field.y[j * _TILE : (j + 1) * _TILE + 1]
        z = field.z[i * _TILE : (i + 1) * _TILE + 1, j * _TILE : (j + 1) * _TILE + 1]
        # Bullet puts the middle between the smallest and the largest height at the origin, and has single precision.
        middle = 0.5 * (z.min() + z.max())
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_HEIGHTFIELD,
            meshScale=[(x[-1] - x[0]) / (len(x) - 1), (y[-1] - y[0]) / (len(y) - 1), 1.0],
            heightfieldData=(z - middle).T.ravel().tolist(),
            numHeightfieldRows=len(x),
            numHeightfieldColumns=len(y),
            physicsClientId=self._client,
        )
        tile = self._fix(shape, [0.5 * (x[0] + x[-1]), 0.5 * (y[0] + y[-1]), middle])
        pybullet.changeDynamics(tile, -1, contactProcessingThreshold=_FARTHEST_LOADED, physicsClientId=self._client)

    def _add(self, shape: HalfSpace | TriangleMesh | Box) -> None:
        if isinstance(shape, TriangleMesh):
            collision = pybullet.createCollisionShape(
                pybullet.GEOM_MESH,
                vertices=shape.vertices.tolist(),
                indices=shape.triangles.ravel().tolist(),
                flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
                physicsClientId=self._client,
            )
            point = [0.0, 0.0, 0.0]
        elif isinstance(shape, Box):
            lower, upper = np.array(shape.lower), np.array(shape.upper)
            collision = pybullet.createCollisionShape(
                pybullet.GEOM_BOX, halfExtents=(0.5 * (upper - lower)).tolist(), physicsClientId=self._client
            )
            point = (0.5 * (lower + upper)).tolist()
        else:
            collision = pybullet.createCollisionShape(
                pybullet.GEOM_PLANE, planeNormal=list(shape.normal), physicsClientId=self._client
            )
            point = list(shape.point)
        self._fix(collision, point)

    def _fix(self, collision: int, point: list[float]) -> int:
        """Fix a shape at a point [m], with the coefficients 1: Bullet multiplies those of two bodies."""
        ground = pybullet.createMultiBody(
            baseMass=0.0,
            baseCollisionShapeIndex=collision,
            baseVisualShapeIndex=self._drawn,
            basePosition=point,
            physicsClientId=self._client,
        )
        pybullet.changeDynamics(
            ground, -1, lateralFriction=1.0, restitution=1.0, rollingFriction=0.0, spinningFriction=0.0,
            physicsClientId=self._client,
        )  # fmt: skip
        return int(ground)


def _tiles(axis: Array, low: float, high: float) -> tuple[int, int]:
    """Return the first tile and the one after the last between two places [m] on an axis, at most all tiles."""
    step = _TILE * (axis[-1] - axis[0]) / (len(axis) - 1)
    count = -(-(len(axis) - 1) // _TILE)
    first, last = np.floor((np.array([low, high]) - axis[0]) / step).clip(-1, count)
    return max(int(first), 0), min(int(last) + 1, count)
