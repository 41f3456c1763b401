"""Terrain of square blocks of different heights: paper A's testbed (A section 5.1, Fig. 9b)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_number, check_whole, checked, read_only
from hexakin.exceptions import InvalidInputError
from hexakin.terrain.base import Box, HalfSpace, check_points, check_positions, check_rays

_MAX_BLOCKS = 100_000  # assumed: far more than any walk needs; in an engine every block is a separate body
_HIGHEST = 10.0  # [m] assumed: a hundred times the height of the robots; a larger height is in millimetres
_BOTTOM = -0.1  # [m] assumed: blocks begin below the ground, so that nothing can get between block and ground
_RAYS_AND_LINES = 1_000_000  # handled at once, which takes about 0.1 GB of memory
_ROUNDING = 1e-9  # [edges of a block] a point closer than this to a grid line counts as on the line


@checked
@dataclass(frozen=True)
class Blocks:
    """Square blocks with level tops, like paper A's testbed; the ground around them is level at z = 0.

    The paper gives blocks 0.1 and 0.2 m wide and 0.04 to 0.13 m high; the layout is assumed here.

    On an edge between blocks the height is that of the higher block. Raises InvalidInputError for a parameter out of
    its range.

    Parameters
    ----------
    size
        Edge of a block [m]. One block is centred on the origin, so that a robot that starts there walks along the
        middle of a row and not along the line between two rows.
    heights
        Lowest and highest allowed top [m], not below the ground. The heights are drawn at random between them.
    max_step
        Largest height difference [m] between blocks that share an edge; with None all heights are independent. It does
        not limit the step from the ground around the blocks to the outer blocks.
    extent
        Area (x_min, x_max, y_min, y_max) [m] to cover with whole blocks. The outer blocks may extend beyond it: the
        default area ends at x = 0.8 m, and its blocks of 0.2 m end at 0.9 m.
    level
        Blocks whose centres lie within this distance [m] of the origin share one height, so that the robot starts on
        level ground; with 0 no blocks are levelled.
    seed
        Seed of the random heights, a whole number. Equal arguments give equal terrain.
    """

    size: float = 0.2
    heights: tuple[float, float] = (0.04, 0.13)
    max_step: float | None = 0.03
    extent: tuple[float, float, float, float] = (-0.8, 0.8, -0.8, 4.0)
    level: float = 0.35
    seed: int = 0

    def __post_init__(self) -> None:
        low, high = self._tuple("heights", 2)
        check_number("Blocks: heights: lowest", low, at_least=0.0, unit="m")
        check_number("Blocks: heights: highest", high, at_least=low, at_most=_HIGHEST, unit="m")
        object.__setattr__(self, "size", check_number("Blocks: size", self.size, above=0.0, unit="m"))
        if self.max_step is not None:
            step = check_number("Blocks: max_step", self.max_step, at_least=0.0, at_most=_HIGHEST, unit="m")
            object.__setattr__(self, "max_step", step)
        object.__setattr__(self, "level", check_number("Blocks: level", self.level, at_least=0.0, unit="m"))
        object.__setattr__(self, "seed", check_whole("Blocks: seed", self.seed))
        x_min, x_max, y_min, y_max = self._tuple("extent", 4)
        for axis, begin, end in (("x", x_min, x_max), ("y", y_min, y_max)):
            check_number(f"Blocks: extent: {axis}_max", end, above=begin, unit="m")
        # One block may be larger than the extent; a thousand times larger, it is a length in millimetres.
        most = 10.0 * max(x_max - x_min, y_max - y_min)
        check_number("Blocks: size", self.size, at_most=most, unit="m")
        count = ((x_max - x_min) / self.size + 1.0) * ((y_max - y_min) / self.size + 1.0)
        if count > _MAX_BLOCKS:
            raise InvalidInputError(
                f"Blocks: size: {self.size:g} m makes about {count:.3g} blocks of the extent {self.extent} m, "
                f"expected at most {_MAX_BLOCKS}"
            )

    def _tuple(self, name: str, length: int) -> tuple[float, ...]:
        """Convert a field to a tuple of plain numbers, so that equal terrains have equal representations."""
        values = check_positions(f"Blocks: {name}", getattr(self, name), (length,), ("number",))
        if values.ndim != 1:
            raise InvalidInputError(f"Blocks: {name}: expected {length} numbers, got shape {values.shape}")
        numbers = tuple(float(value) for value in values)
        object.__setattr__(self, name, numbers)
        return numbers

    def _centers(self, axis: int) -> Array:
        """Return the centres of the blocks along x (0) or y (1) as multiples of a block's edge: whole numbers."""
        begin, end = (edge / self.size for edge in self.extent[2 * axis : 2 * axis + 2])
        first, last = np.floor(begin + 0.5 + _ROUNDING), np.ceil(end - 0.5 - _ROUNDING)
        return np.arange(first, max(first, last) + 1.0)

    def _edges(self, axis: int) -> Array:
        centers = self._centers(axis)
        return read_only(self.size * (np.append(centers, centers[-1] + 1.0) - 0.5))

    @cached_property
    def x_edges(self) -> Array:
        """Positions (nx + 1,) [m] along x where blocks begin and end, ascending."""
        return self._edges(0)

    @cached_property
    def y_edges(self) -> Array:
        """Positions (ny + 1,) [m] along y where blocks begin and end, ascending."""
        return self._edges(1)

    @cached_property
    def tops(self) -> Array:
        """Heights (nx, ny) [m] of the blocks.

        The blocks are visited in random order. Each height is drawn uniformly from the interval of heights that the
        earlier blocks still allow. If any two drawn heights differ by at most max_step times the number of steps from
        one block to the other, allowed heights exist for all other blocks (McShane's extension of Lipschitz functions,
        1934). So no height is drawn twice or corrected later. The method prefers no direction and neither high nor low
        blocks, and it uses the whole range. Two other methods were rejected: a random walk from block to block depends
        on its first block, and smoothing independent heights moves them towards the middle of the range.
        """
        low, high = self.heights
        rng = np.random.default_rng(self.seed)
        i, j = self._centers(0), self._centers(1)
        least, most = np.full((len(i), len(j)), low), np.full((len(i), len(j)), high)
        tops = np.empty_like(least)
        span, longest = high - low, max(least.shape)
        step = span if self.max_step is None else self.max_step
        # A height does not restrict blocks that are at least this many blocks away.
        free = np.ceil(span / step) if step > 0.0 else np.inf
        reach = int(min(longest, max(free - 1.0, 0.0)))

        def settle(a: int, b: int, z: float) -> None:
            tops[a, b] = z
            near = slice(max(a - reach, 0), a + reach + 1), slice(max(b - reach, 0), b + reach + 1)
            change = step * np.add.outer(np.abs(i[near[0]] - i[a]), np.abs(j[near[1]] - j[b]))
            least[near] = np.maximum(least[near], z - change)
            most[near] = np.minimum(most[near], z + change)

        level = (np.hypot.outer(i, j) <= self.level / self.size + _ROUNDING) & (self.level > 0.0)
        common = rng.uniform(low, high)
        for a, b in np.argwhere(level):
            settle(a, b, common)
        for a, b in rng.permutation(np.argwhere(~level)):
            settle(a, b, least[a, b] + rng.random() * (most[a, b] - least[a, b]))
        return read_only(tops)

    @cached_property
    def _tops_and_ground(self) -> Array:
        return read_only(np.pad(self.tops, 1))  # z = 0 all around

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the height (...) [m] of the ground at ``x`` (...) [m] and ``y`` (...) [m].

        On an edge between blocks the result is the height of the highest of these blocks.
        """
        return self._height(*check_points(x, y))

    def _height(self, px: Array, py: Array) -> Array:
        # The left and the right index differ only exactly on an edge, where they are the blocks on its two sides.
        (a, b), (c, d) = (
            (edges.searchsorted(p, side="left"), edges.searchsorted(p, side="right"))
            for edges, p in ((self.x_edges, px), (self.y_edges, py))
        )
        tops = self._tops_and_ground
        return np.maximum(np.maximum(tops[a, c], tops[a, d]), np.maximum(tops[b, c], tops[b, d]))

    def normal(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the unit normal (..., 3), upwards everywhere, at ``x`` (...) [m] and ``y`` (...) [m]."""
        px, _ = check_points(x, y)
        return np.tile([0.0, 0.0, 1.0], (*px.shape, 1))

    def distance_along(self, origin: ArrayLike, direction: ArrayLike) -> Array:
        """Return the distance (...) [m] along a ray from ``origin`` (..., 3) [m] to the ground.

        ``direction`` (..., 3) is the ray's unit vector. The ray can hit a top or a side of a block. The distance is inf
        if the ray misses the ground. If the origin is under the ground, the result is the vertical gap, which is
        negative.
        """
        p, d = check_rays(origin, direction)
        rays = np.concatenate([p, d], axis=-1).reshape(-1, 6)
        at_once = max(_RAYS_AND_LINES // (len(self.x_edges) + len(self.y_edges)), 1)
        parts = [self._distances(rays[k : k + at_once]) for k in range(0, len(rays), at_once)]
        return np.concatenate([np.empty(0), *parts]).reshape(p.shape[:-1])

    def _distances(self, rays: Array) -> Array:
        """Return the distances (n,) [m] to the ground along rays (n, 6), each an origin and a unit vector."""
        p, d = rays[:, :3], rays[:, 3:]
        gap = p[..., 2] - self._height(p[..., 0], p[..., 1])
        x, y, z, dx, dy, dz = (values[..., axis, None] for values in (p, d) for axis in range(3))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # The ray is split where it crosses a line of the grid; on each piece the ground is level.
            lines = np.concatenate([(self.x_edges - x) / dx, (self.y_edges - y) / dy], axis=-1)
            lines = np.sort(np.where(lines >= 0.0, lines, np.inf), axis=-1)
            begin = np.concatenate([np.zeros_like(z), lines], axis=-1)
            end = np.concatenate([lines, np.full_like(z, np.inf)], axis=-1)
            passed = np.isfinite(begin)
            begin = np.where(passed, begin, 0.0)
            middle = np.where(np.isfinite(end), 0.5 * begin + 0.5 * end, begin + 1.0)
            ground = self._height(x + middle * dx, y + middle * dy)
            to_top = np.maximum((ground - z) / dz, begin)
            hits_side = z + begin * dz < ground
            hits_top = (dz < 0.0) & (to_top <= end)
        distance = np.where(hits_side, begin, np.where(hits_top, to_top, np.inf))
        distance = np.where(passed, distance, np.inf).min(axis=-1)
        return np.where(gap < 0.0, gap, distance)

    def shapes(self) -> tuple[HalfSpace | Box, ...]:
        """Return the level ground and one box for each block."""
        x, y, z = self.x_edges.tolist(), self.y_edges.tolist(), self.tops.tolist()
        boxes = (
            Box((x[a], y[b], _BOTTOM), (x[a + 1], y[b + 1], z[a][b]))
            for a in range(len(x) - 1)
            for b in range(len(y) - 1)
        )
        return (HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), *boxes)
