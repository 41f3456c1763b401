"""Heights, normals and shapes of level ground, ramps, blocks, elevation data and paper B's leg curves."""

from hexakin.terrain.base import Box, HalfSpace, Terrain, TriangleMesh
from hexakin.terrain.blocks import Blocks
from hexakin.terrain.height_field import HeightField
from hexakin.terrain.leg_curves import LegCurves
from hexakin.terrain.planes import Plane, Ramp

__all__ = ["Blocks", "Box", "HalfSpace", "HeightField", "LegCurves", "Plane", "Ramp", "Terrain", "TriangleMesh"]
