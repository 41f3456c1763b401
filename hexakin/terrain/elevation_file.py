"""Read elevation data: GeoTIFF, ESRI ASCII grids, NumPy archives and grey images."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hexakin.checks import Array, check_array, check_number
from hexakin.checks.files import check_file, opened_arrays
from hexakin.exceptions import (
    FileError,
    InvalidInputError,
    MissingPackageError,
    TerrainFileError,
    UnknownNameError,
    shown,
)
from hexakin.terrain.base import MOST_POINTS, check_positions

_LARGEST = 2**30  # [bytes] of the arrays in an archive, unpacked
_LONGEST = 1_000_000  # [points] along one axis of a file
_METRES = ("", "m", "metre", "metres", "meter", "meters")  # names of the unit in GeoTIFF files


def read_elevation(
    path: Path,
    scale: float | None,
    pixel: ArrayLike | None,
    heights: ArrayLike | None,
    missing: float | str | None,
    origin: ArrayLike | str | None,
    window: ArrayLike | None,
) -> tuple[Array, Array, Array]:
    """Return ``x`` (nx,), ``y`` (ny,) and ``z`` (nx, ny) [m] of the file ``path``.

    ``scale`` [m per unit], ``pixel`` (2,) [m], ``heights`` (2,) [m], ``missing``, ``origin`` (2,) [m], ``window`` (4,)
    [m] and errors as for ``HeightField.from_file``.
    """
    ending = path.suffix.lower()
    if ending not in (".tif", ".tiff", ".asc", ".npz", ".png"):
        raise UnknownNameError("elevation format", ending, [".tif", ".tiff", ".asc", ".npz", ".png"])
    factor = None if scale is None else check_number("scale", scale, above=0.0, unit="m")
    size = None if pixel is None else _pixel(pixel)
    if isinstance(missing, str):
        if missing != "nearest":
            raise UnknownNameError("missing", missing, ["nearest", "a height [m]"])
    elif missing is not None:
        missing = check_number("missing", missing, unit="m")
    if (heights is None) == (ending == ".png"):
        expected = "the heights of black and white for a .png file" if ending == ".png" else f"None for {ending}"
        raise InvalidInputError(f"heights: {shown(heights)}, expected {expected}")
    if ending == ".png" and scale is not None:
        raise InvalidInputError(f"scale: {scale}, expected None for .png, which has heights")
    part = None if window is None else _window(window)
    zero = origin if origin is None or isinstance(origin, str) else _numbers("origin", origin, 2)
    if isinstance(zero, str) and zero != "centre":
        raise UnknownNameError("origin", zero, ["centre"])
    try:
        check_file(path)
        if ending == ".npz":
            x, y, z = _from_archive(path, factor, size, part)
        elif ending == ".png":
            x, y, z = _from_image(path, size, _numbers("heights", heights, 2), part)
        else:
            x, y, z = _from_raster(path, factor, size, part)
    except FileError as error:
        raise TerrainFileError(str(error)) from error
    z = _without_gaps(path, x, y, z, missing)
    if zero is not None:
        at = (0.5 * (x[0] + x[-1]), 0.5 * (y[0] + y[-1])) if isinstance(zero, str) else zero
        x, y = x - at[0], y - at[1]
    return x, y, z


def _numbers(name: str, value: ArrayLike | None, count: int) -> tuple[float, ...]:
    array = check_positions(name, () if value is None else value, (count,))
    if array.ndim != 1:
        raise InvalidInputError(f"{name}: expected {count} numbers, got shape {array.shape}")
    return tuple(array.tolist())


def _pixel(value: ArrayLike) -> tuple[float, ...]:
    sides = check_array("pixel", value, ())
    both = _numbers("pixel", np.broadcast_to(sides, 2) if sides.ndim == 0 else sides, 2)
    return tuple(check_number("pixel", side, above=0.0, unit="m") for side in both)


def _window(value: ArrayLike) -> tuple[float, ...]:
    x_min, x_max, y_min, y_max = _numbers("window", value, 4)
    check_number("window: x_max", x_max, above=x_min, unit="m")
    check_number("window: y_max", y_max, above=y_min, unit="m")
    return x_min, x_max, y_min, y_max


def _part(path: Path, x: Array, y: Array, window: tuple[float, ...] | None) -> tuple[slice, slice]:
    """Return the indices along x and y of the points in the window; raise TerrainFileError for too few or too many."""
    x_min, x_max, y_min, y_max = (-np.inf, np.inf, -np.inf, np.inf) if window is None else window
    parts = []
    for name, axis, low, high in (("x", x, x_min, x_max), ("y", y, y_min, y_max)):
        inside = np.flatnonzero((axis >= low) & (axis <= high))
        if len(inside) < 2:
            raise TerrainFileError(
                f"{path}: {len(inside)} points along {name} in the window, expected at least 2; {name} ranges from "
                f"{axis.min():.10g} to {axis.max():.10g} m"
            )
        parts.append(slice(int(inside[0]), int(inside[-1]) + 1))
    count = [part.stop - part.start for part in parts]
    if count[0] * count[1] > MOST_POINTS:
        raise TerrainFileError(
            f"{path}: {count[0]} x {count[1]} points, expected at most {MOST_POINTS}; window= reads a part"
        )
    return parts[0], parts[1]


def _without_gaps(path: Path, x: Array, y: Array, z: Array, missing: float | str | None) -> Array:
    """Return heights (nx, ny) [m] in which ``missing`` has replaced those that are not finite."""
    gaps = ~np.isfinite(z)
    if not gaps.any():
        return z
    if missing is None or gaps.all():
        # The first in the order of an image: row by row, from the top.
        i, j = min(np.argwhere(gaps).tolist(), key=lambda index: (-y[index[1]], x[index[0]]))
        raise TerrainFileError(
            f"{path}: {gaps.sum()} of {z.size} heights are missing, the first at x = {x[i]:.10g} m, y = {y[j]:.10g} m"
            + ("" if gaps.all() else "; missing='nearest' or missing=0.0 (a height) replaces them")
        )
    if isinstance(missing, str):
        from scipy import ndimage  # here, since few files need it

        nearest = ndimage.distance_transform_edt(
            gaps, sampling=(abs(x[1] - x[0]), abs(y[1] - y[0])), return_distances=False, return_indices=True
        )
        return z[tuple(nearest)]
    return np.where(gaps, missing, z)


def _from_archive(
    path: Path, scale: float | None, pixel: tuple[float, ...] | None, window: tuple[float, ...] | None
) -> tuple[Array, Array, Array]:
    if pixel is not None:
        raise InvalidInputError(f"pixel: {pixel}, expected None for .npz, which has x and y")
    with opened_arrays(path, _LARGEST) as archive:
        if lacking := [name for name in "xyz" if name not in archive.headers]:
            raise TerrainFileError(f"{path}: {', '.join(lacking)} missing, expected the arrays x, y and z")
        x_shape, y_shape, z_shape = (archive.headers[name].shape for name in "xyz")
        if len(x_shape) != 1 or len(y_shape) != 1 or z_shape != (*x_shape, *y_shape):
            raise TerrainFileError(
                f"{path}: x, y and z have shapes {x_shape}, {y_shape} and {z_shape}, expected (nx,), (ny,) and (nx, ny)"
            )
        if any(archive.headers[name].dtype.kind not in "iuf" for name in "xyz"):
            raise TerrainFileError(f"{path}: expected numbers in x, y and z")
        x, y = archive.read("x"), archive.read("y")
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise TerrainFileError(f"{path}: expected finite numbers in x and y")
        columns, rows = _part(path, x, y, window)
        return x[columns], y[rows], archive.read("z")[columns, rows].astype(float) * (scale or 1.0)


def _from_image(
    path: Path, pixel: tuple[float, ...] | None, heights: tuple[float, ...], window: tuple[float, ...] | None
) -> tuple[Array, Array, Array]:
    from PIL import Image  # here, since it takes as long to load as the rest of this package

    if pixel is None:
        raise InvalidInputError("pixel: None, expected the width of a pixel [m] for .png")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # sizes are checked here
            image = Image.open(path, formats=["PNG"])
        with image:
            if image.mode not in ("L", "I;16", "I"):
                raise TerrainFileError(f"{path}: an image of mode {image.mode}, expected grey of 8 or 16 bit")
            x, y = _axis(path, 0.0, pixel[0], image.width), _axis(path, 0.0, pixel[1], image.height)[::-1]
            columns, rows = _part(path, x, y, window)
            part = image.crop((columns.start, rows.start, columns.stop, rows.stop))
            grey = np.asarray(part, dtype=float).T / (255.0 if image.mode == "L" else 65535.0)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:  # of a damaged or huge file
        if isinstance(error, (TerrainFileError, InvalidInputError)):
            raise
        raise TerrainFileError(f"{path}: truncated or damaged, or no .png image ({error})") from error
    return x[columns], y[rows], heights[0] + (heights[1] - heights[0]) * grey


def _from_raster(
    path: Path, scale: float | None, pixel: tuple[float, ...] | None, window: tuple[float, ...] | None
) -> tuple[Array, Array, Array]:
    try:
        import rasterio
    except ImportError as error:
        raise MissingPackageError("rasterio", f"reading {path.suffix}", "pip install rasterio") from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            dataset = rasterio.open(path.absolute(), driver="AAIGrid" if path.suffix.lower() == ".asc" else "GTiff")
        with dataset:
            x, y = _axes(path, dataset, pixel)
            unit = (dataset.units[0] or "").strip()
            if scale is None and unit.lower() not in _METRES:
                raise TerrainFileError(f"{path}: heights in the unit {shown(unit)}; scale= converts them to metres")
            columns, rows = _part(path, x, y, window)
            values = dataset.read(1, window=((rows.start, rows.stop), (columns.start, columns.stop)), masked=True)
            z = values.astype(float).filled(np.nan) * dataset.scales[0] + dataset.offsets[0]
    except rasterio.errors.RasterioError as error:
        raise TerrainFileError(f"{path}: truncated or damaged, or not of this format ({error})") from error
    return x[columns], y[rows], z.T * (scale or 1.0)


def _axes(path: Path, dataset: Any, pixel: tuple[float, ...] | None) -> tuple[Array, Array]:
    """Return the centres of the pixels (nx,) and (ny,) [m] of a rasterio dataset, in the order of columns and rows."""
    if dataset.count != 1 or not np.issubdtype(np.dtype(dataset.dtypes[0]), np.number) or "c" in dataset.dtypes[0]:
        raise TerrainFileError(f"{path}: {dataset.count} bands of {dataset.dtypes[0]}, expected one band of numbers")
    crs, grid = dataset.crs, dataset.transform
    if crs is not None and crs.is_geographic:
        raise TerrainFileError(
            f"{path}: coordinates in degrees ({crs.to_string():.80}), expected metres; project it first, for example "
            "with gdalwarp -t_srs"
        )
    if crs is not None:
        name, factor = crs.linear_units_factor
        if abs(factor - 1.0) > 1e-12:
            raise TerrainFileError(f"{path}: coordinates in the unit {name}, expected metres; project it first")
    if grid.b != 0.0 or grid.d != 0.0:
        raise TerrainFileError(f"{path}: a rotated grid, expected rows along x and columns along y; project it first")
    if grid.is_identity:  # what GDAL says of a file without georeference
        if pixel is None:
            raise TerrainFileError(f"{path}: no georeference; pixel= gives the width of a pixel [m]")
        width, height = pixel
        return _axis(path, 0.0, width, dataset.width), _axis(path, 0.0, height, dataset.height)[::-1]
    if pixel is not None:
        raise InvalidInputError(f"pixel: {pixel}, expected None for {path.name}, which has a georeference")
    return (
        _axis(path, grid.c + 0.5 * grid.a, grid.a, dataset.width),
        _axis(path, grid.f + 0.5 * grid.e, grid.e, dataset.height),
    )


def _axis(path: Path, first: float, step: float, count: int) -> Array:
    if count > _LONGEST:
        raise TerrainFileError(f"{path}: {count} points along one axis, expected at most {_LONGEST}")
    return first + step * np.arange(count, dtype=float)
