"""Elevation data become a terrain of the same heights at the same places, or the fault is named."""

import importlib.util
import zlib

import numpy as np
import pytest
from PIL import Image

from hexakin.exceptions import InvalidInputError, MissingPackageError, TerrainFileError, UnknownNameError
from hexakin.terrain import HeightField

HAS_RASTERIO = importlib.util.find_spec("rasterio") is not None
needs_rasterio = pytest.mark.skipif(not HAS_RASTERIO, reason="rasterio is not installed (tests/elevation.txt)")

# Rows from north to south, as in a map: 3 rows of 4 points.
MAP = np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0], [9.0, 10.0, 11.0, 12.5]])
EAST, NORTH = 500_000.0, 4_649_776.0  # of the upper left corner, in UTM


@pytest.fixture
def tif(tmp_path):
    """Writes a GeoTIFF of MAP, in which options change what it says of itself."""

    def write(values=MAP, transform=(2.0, 0.0, EAST, 0.0, -0.5, NORTH), crs="EPSG:32633", **options):
        import rasterio

        bands = np.atleast_3d(np.asarray(values).T).T
        profile = {"count": len(bands), "height": bands.shape[1], "width": bands.shape[2], "dtype": bands.dtype.name}
        place = None if transform is None else rasterio.Affine(*transform)
        about = {name: options.pop(name) for name in ("units", "scales", "offsets") if name in options}
        with rasterio.open(
            tmp_path / "map.tif", "w", driver="GTiff", transform=place, crs=crs, **profile, **options
        ) as dataset:
            dataset.write(bands)
            for name, value in about.items():
                setattr(dataset, name, value)
        return tmp_path / "map.tif"

    return write


@pytest.fixture
def asc(tmp_path):
    def write(header="NODATA_value -9999\n", values=MAP, name="map.asc", corner=(10.0, 20.0)):
        rows = "\n".join(" ".join(map(str, row)) for row in values)
        size = f"ncols {values.shape[1]}\nnrows {values.shape[0]}\n"
        place = f"xllcorner {corner[0]}\nyllcorner {corner[1]}\ncellsize 0.5\n"
        (tmp_path / name).write_text(size + place + header + rows + "\n", encoding="utf-8")
        return tmp_path / name

    return write


@pytest.fixture
def png(tmp_path):
    def write(values, name="map.png"):
        Image.fromarray(values).save(tmp_path / name)
        return tmp_path / name

    return write


@pytest.fixture
def npz(tmp_path):
    def write(**arrays):
        given = {"x": [0.0, 1.0, 2.0], "y": [0.0, 0.5], "z": [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]}
        np.savez_compressed(tmp_path / "map.npz", **{n: v for n, v in (given | arrays).items() if v is not None})
        return tmp_path / "map.npz"

    return write


@needs_rasterio
@pytest.mark.parametrize("kind", ["float32", "float64", "int16", "uint8"])
def test_a_geotiff_has_its_heights_at_the_centres_of_its_pixels_with_north_up(tif, kind):
    field = HeightField.from_file(tif(MAP.astype(kind)))
    assert field.x == pytest.approx(EAST + 1.0 + 2.0 * np.arange(4), abs=1e-9)
    assert field.y == pytest.approx(NORTH - 1.25 + 0.5 * np.arange(3), abs=1e-9)
    np.testing.assert_array_equal(field.z, MAP.astype(kind)[::-1].T)


@needs_rasterio
def test_a_map_of_large_coordinates_is_moved_to_where_walks_begin(tif):
    path = tif()
    centred = HeightField.from_file(path, origin="centre")
    assert centred.x == pytest.approx([-3, -1, 1, 3], abs=1e-9) and centred.y == pytest.approx([-0.5, 0, 0.5], abs=1e-9)
    assert centred.height(-3.0, 0.5) == pytest.approx(1.0)
    corner = HeightField.from_file(path, origin=(EAST, NORTH))
    assert corner.height(1.0, -0.25) == pytest.approx(1.0) and corner.height(7.0, -1.25) == pytest.approx(12.5)


@needs_rasterio
def test_a_window_reads_a_part(tif):
    field = HeightField.from_file(tif(), window=(EAST + 2.0, EAST + 6.0, NORTH - 1.0, NORTH))
    np.testing.assert_array_equal(field.z, MAP[:2, 1:3][::-1].T)
    with pytest.raises(TerrainFileError, match=r"0 points along x in the window.*x ranges from 500001 to 500007 m"):
        HeightField.from_file(tif(), window=(0, 1, 0, 1))


@needs_rasterio
def test_a_file_larger_than_a_field_may_be_is_refused_unread_and_read_in_part(tif, tmp_path):
    """Of 10^5 x 10^5 points, which are not stored."""
    import rasterio

    path = tmp_path / "large.tif"
    with rasterio.open(
        path, "w", driver="GTiff", count=1, width=100_000, height=100_000, dtype="float32", tiled=True, sparse_ok=True,
        bigtiff="YES", crs="EPSG:32633", transform=rasterio.Affine(1.0, 0.0, EAST, 0.0, -1.0, NORTH),
    ):  # fmt: skip
        pass
    with pytest.raises(TerrainFileError, match=r"100000 x 100000 points, .*; window= reads a part"):
        HeightField.from_file(path)
    assert HeightField.from_file(path, window=(EAST, EAST + 10.0, NORTH - 20.0, NORTH)).z.shape == (10, 20)


@needs_rasterio
@pytest.mark.parametrize("hole", [-9999.0, np.nan])
def test_missing_heights_are_named_or_replaced(tif, hole):
    values = MAP.astype("float32").copy()
    values[0, 3] = values[1, 0] = hole
    path = tif(values, nodata=-9999.0)
    with pytest.raises(
        TerrainFileError, match=r"map\.tif: 2 of 12 heights are missing, the first at x = 500007 m, y = 4649775\.75 m"
    ):
        HeightField.from_file(path)
    level = HeightField.from_file(path, missing=-1.5).z
    assert (level == -1.5).sum() == 2 and level[3, 2] == level[0, 1] == -1.5
    # Rows are 0.5 m apart, columns 2 m.
    nearest = HeightField.from_file(path, missing="nearest").z
    assert nearest[3, 2] == MAP[1, 3] and nearest[0, 1] in (MAP[0, 0], MAP[2, 0])
    everywhere = tif(np.full((2, 2), np.nan))
    with pytest.raises(TerrainFileError, match="4 of 4 heights are missing"):
        HeightField.from_file(everywhere, missing="nearest")


@needs_rasterio
@pytest.mark.parametrize(
    "options, message",
    [
        ({"crs": "EPSG:4326"}, r"coordinates in degrees \(EPSG:4326\), expected metres"),
        ({"crs": "EPSG:2263"}, "coordinates in the unit US survey foot, expected metres"),
        ({"transform": (1.9, 0.3, 0.0, 0.3, -1.9, 0.0)}, "a rotated grid"),
        ({"transform": None, "crs": None}, r"no georeference; pixel= gives the width"),
        ({"values": np.zeros((3, 2, 2))}, "3 bands of float64, expected one band of numbers"),
        ({"values": np.zeros((2, 2), dtype="complex64")}, "1 bands of complex64, expected one band of numbers"),
        ({"units": ("ft",)}, "heights in the unit 'ft'; scale= converts them"),
        ({"values": np.zeros((1, 4))}, "1 points along y in the window, expected at least 2"),
    ],
)
def test_what_a_geotiff_may_not_be_is_named(tif, options, message):
    with pytest.raises(TerrainFileError, match=f"map.tif: {message}"):
        HeightField.from_file(tif(**options))


@needs_rasterio
def test_units_of_height_are_converted(tif):
    assert HeightField.from_file(tif(units=("ft",)), scale=0.3048).z[0, 0] == pytest.approx(9 * 0.3048)
    assert HeightField.from_file(tif(units=("metre",))).z[0, 0] == 9.0
    stored = HeightField.from_file(tif(MAP.astype("int16"), scales=(0.1,), offsets=(100.0,)))
    assert stored.z[0, 0] == pytest.approx(100.9)


@needs_rasterio
def test_a_tiff_without_georeference_takes_the_size_of_a_pixel(tif):
    field = HeightField.from_file(tif(transform=None, crs=None), pixel=(0.1, 0.2))
    assert field.x == pytest.approx([0.0, 0.1, 0.2, 0.3]) and field.y == pytest.approx([0.0, 0.2, 0.4])
    np.testing.assert_array_equal(field.z, MAP[::-1].T)
    with pytest.raises(InvalidInputError, match=r"pixel: .*map\.tif, which has a georeference"):
        HeightField.from_file(tif(), pixel=0.1)


@needs_rasterio
def test_an_ascii_grid_is_read_with_its_gaps(asc):
    field = HeightField.from_file(asc())
    assert field.x == pytest.approx(10.25 + 0.5 * np.arange(4)) and field.y == pytest.approx(20.25 + 0.5 * np.arange(3))
    assert field.z == pytest.approx(MAP[::-1].T)
    values = MAP.copy()
    values[2, 1] = -9999
    with pytest.raises(TerrainFileError, match=r"1 of 12 heights are missing, the first at x = 10\.75 m, y = 20\.25 m"):
        HeightField.from_file(asc(values=values))


@needs_rasterio
@pytest.mark.parametrize("name", ["map.tif", "map.asc"])
def test_damaged_maps_are_named(tmp_path, tif, asc, name, rng):
    whole = (tif() if name == "map.tif" else asc()).read_bytes()
    path = tmp_path / name
    for content in (b"", b"nothing", whole[:20], whole[: len(whole) // 2]):
        path.write_bytes(content)
        with pytest.raises(TerrainFileError, match=name):
            HeightField.from_file(path, missing=0.0)
    for _ in range(50):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        try:
            HeightField.from_file(path, missing=0.0)
        except TerrainFileError as error:
            assert name in str(error)


def test_maps_without_the_reader_name_the_package(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "rasterio", None)
    for name in ("map.tif", "map.TIFF", "map.asc"):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(MissingPackageError, match=r"reading \.\w+ needs the package 'rasterio'.*pip install"):
            HeightField.from_file(tmp_path / name)


@pytest.mark.parametrize("kind, white", [(np.uint8, 255), (np.uint16, 65535)])
def test_a_grey_image_has_heights_from_black_to_white(png, kind, white):
    values = np.array([[0, white, white // 5], [white, 0, 0]], dtype=kind)
    field = HeightField.from_file(png(values), pixel=(0.01, 0.02), heights=(-0.1, 0.4))
    assert field.x == pytest.approx([0.0, 0.01, 0.02]) and field.y == pytest.approx([0.0, 0.02])
    assert field.z == pytest.approx(np.array([[0.4, -0.1, -0.1], [-0.1, 0.4, 0.0]]).T)
    assert HeightField.from_file(png(values), pixel=0.01, heights=(0.0, 1.0)).y[1] == 0.01


@pytest.mark.parametrize(
    "values, options, error, message",
    [
        (np.zeros((2, 2, 3), dtype=np.uint8), {}, TerrainFileError, "an image of mode RGB, expected grey"),
        (np.zeros((1, 2), dtype=np.uint8), {}, TerrainFileError, "1 points along y"),
        (None, {"pixel": None}, InvalidInputError, "pixel: None, expected the width of a pixel"),
        (None, {"pixel": 0.0}, InvalidInputError, "pixel: 0 m, expected above 0"),
        (None, {"pixel": (1, 2, 3)}, InvalidInputError, "pixel: expected"),
        (None, {"heights": None}, InvalidInputError, "heights: None, expected the heights of black and white"),
        (None, {"heights": (0.0, np.nan)}, InvalidInputError, "heights: .* nan"),
        (None, {"scale": 0.001}, InvalidInputError, "scale: 0.001, expected None for .png"),
        (None, {"missing": "linear"}, UnknownNameError, "unknown missing 'linear'; known: nearest, a height"),
        (None, {"origin": "middle"}, UnknownNameError, "unknown origin 'middle'; known: centre"),
        (None, {"origin": (1, 2, 3)}, InvalidInputError, "origin: expected"),
        (None, {"window": (1, 0, 0, 1)}, InvalidInputError, "window: x_max: 0 m, expected above 1"),
        (None, {"window": (5, 6, 0, 1)}, TerrainFileError, "0 points along x in the window"),
    ],
)
def test_wrong_images_and_options_are_named(png, values, options, error, message):
    path = png(np.zeros((2, 2), dtype=np.uint8) if values is None else values)
    with pytest.raises(error, match=message):
        HeightField.from_file(path, **{"pixel": 0.1, "heights": (0.0, 1.0)} | options)


def test_an_image_that_claims_to_be_huge_is_refused_unread(png, tmp_path):
    content = bytearray(png(np.zeros((2, 2), dtype=np.uint8)).read_bytes())
    content[16:24] = (50_000).to_bytes(4, "big") * 2  # width and height, in the first chunk
    content[29:33] = zlib.crc32(content[12:29]).to_bytes(4, "big")
    (tmp_path / "huge.png").write_bytes(content)
    with pytest.raises(TerrainFileError, match=r"huge\.png"):
        HeightField.from_file(tmp_path / "huge.png", pixel=0.1, heights=(0.0, 1.0))


@pytest.mark.parametrize("name", ["map.png", "map.npz"])
def test_other_damaged_files_are_named(tmp_path, png, npz, name, rng):
    whole = (png(np.zeros((9, 9), dtype=np.uint8)) if name == "map.png" else npz()).read_bytes()
    options = {"pixel": 0.1, "heights": (0.0, 1.0)} if name == "map.png" else {}
    path = tmp_path / name
    for content in (b"", b"nothing", whole[:30], whole[: len(whole) // 2]):
        path.write_bytes(content)
        with pytest.raises(TerrainFileError, match=name):
            HeightField.from_file(path, **options)
    for _ in range(100):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        try:
            HeightField.from_file(path, **options)
        except TerrainFileError as error:
            assert name in str(error)


def test_an_archive_of_arrays_is_read(npz):
    field = HeightField.from_file(npz())
    assert field.x.tolist() == [0, 1, 2] and field.y.tolist() == [0, 0.5] and field.z[2, 1] == 5.0
    assert HeightField.from_file(npz(z=np.full((3, 2), 250, dtype=np.int16)), scale=0.001).z[0, 0] == 0.25
    turned = HeightField.from_file(npz(y=np.float32([0.5, 0.0])), window=(0.5, 2.5, -1.0, 1.0), origin=(1.0, 0.0))
    assert turned.x.tolist() == [0, 1] and turned.z.tolist() == [[3.0, 2.0], [5.0, 4.0]]
    gap = npz(z=[[0.0, 1.0], [2.0, np.nan], [4.0, 5.0]])
    with pytest.raises(TerrainFileError, match=r"1 of 6 heights are missing, the first at x = 1 m, y = 0\.5 m"):
        HeightField.from_file(gap)
    assert HeightField.from_file(gap, missing=0.25).z[1, 1] == 0.25


@pytest.mark.parametrize(
    "arrays, message",
    [
        ({"z": None}, "z missing, expected the arrays x, y and z"),
        ({"z": np.zeros((2, 3))}, r"x, y and z have shapes \(3,\), \(2,\) and \(2, 3\), expected \(nx,\), \(ny,\) and"),
        ({"z": np.zeros((3, 2), dtype=bool)}, "expected numbers in x, y and z"),
        ({"z": np.full((3, 2), "1")}, "expected numbers in x, y and z"),
        ({"x": [0.0, np.nan, 2.0]}, "expected finite numbers in x and y"),
        ({"x": [0.0, 1.0, 3.0]}, "HeightField: x must be at least two evenly spaced"),
        ({"z": np.full((3, 2), None)}, "z: elements of object"),
    ],
)
def test_other_arrays_are_named(npz, arrays, message):
    with pytest.raises(TerrainFileError, match=f"map.npz: {message}"):
        HeightField.from_file(npz(**arrays))


def test_other_files_are_named(tmp_path):
    with pytest.raises(UnknownNameError, match=r"unknown elevation format '\.txt'; known: \.tif, \.tiff, \.asc"):
        HeightField.from_file(tmp_path / "map.txt")
    with pytest.raises(TerrainFileError, match=r"map\.npz: no such file"):
        HeightField.from_file(tmp_path / "map.npz")
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(TerrainFileError, match=r"folder\.npz: cannot be read \(not a file\)"):
        HeightField.from_file(tmp_path / "folder.npz")
    for path in (1, b"map.npz", "", None):
        with pytest.raises(InvalidInputError, match="path: expected a path"):
            HeightField.from_file(path)
