"""Elevation models with map coordinates: ESRI grids and GeoTIFF."""

import re

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import Heightmap, height_and_gradient
from agrobot_mj.terrain.geotiff import GEO_KEYS, NODATA, PIXEL_SCALE, TIE_POINT

EAST, NORTH, CELL = 600_000.0, 5_000_000.0, 2.0
ROWS, COLUMNS = 5, 7


def height(east, north):
    """Return the height of a plane at map coordinates [m]."""
    return 100.0 + 0.05 * (east - EAST) - 0.02 * (north - NORTH)


def grid(first=0.5):
    """Return the heights of cells, first row north, for a south-west corner at EAST, NORTH."""
    x = EAST + CELL * (np.arange(COLUMNS) + first)
    y = NORTH + CELL * (np.arange(ROWS) + first)
    return height(x[None, :], y[::-1, None])


def tiff(folder, values, model=1, raster=1, scale=(CELL, CELL), tags=True, nodata=None, tie=None):
    """Write a GeoTIFF of 32-bit floats with its tie point at the north-west corner."""
    info = TiffImagePlugin.ImageFileDirectory_v2()
    types = {PIXEL_SCALE: 12, TIE_POINT: 12, GEO_KEYS: 3}
    written = {
        PIXEL_SCALE: (*scale, 0.0),
        TIE_POINT: tie or (0.0, 0.0, 0.0, EAST, NORTH + CELL * ROWS, 0.0),
        GEO_KEYS: (1, 1, 0, 2, 1024, 0, 1, model, 1025, 0, 1, raster),
    }
    if tags:
        for tag, value in written.items():
            info.tagtype[tag], info[tag] = types[tag], value
    if nodata is not None:
        info.tagtype[NODATA], info[NODATA] = 2, nodata
    file = folder / "dem.tif"
    Image.fromarray(np.asarray(values, dtype=np.float32)).save(file, tiffinfo=info)
    return str(file)


def asc(folder, values, where="xllcorner 600000\nyllcorner 5000000"):
    head = f"ncols {COLUMNS}\nnrows {ROWS}\n{where}\ncellsize {CELL:g}\n"
    file = folder / "dem.asc"
    file.write_text(head + "\n".join(" ".join(f"{v:.6f}" for v in row) for row in values) + "\n")
    return str(file)


def check(ground, origin):
    """Check that the ground has the heights of the map at points relative to the origin."""
    for east, north in ((EAST + 3.3, NORTH + 4.1), (EAST + 9.0, NORTH + 2.5)):
        found = height_and_gradient(ground, east - origin[0], north - origin[1])[0]
        assert found == pytest.approx(height(east, north), abs=1e-4)


ORIGIN = (EAST + 4.0, NORTH - 20.0)


def test_esri_grid_is_positioned_by_its_corner_or_its_centre(tmp_path):
    check(Heightmap(file=asc(tmp_path, grid()), map_origin_m=ORIGIN).ground(), ORIGIN)
    centres = f"xllcenter {EAST + 1:.1f}\nyllcenter {NORTH + 1:.1f}"
    check(Heightmap(file=asc(tmp_path, grid(), centres), map_origin_m=ORIGIN).ground(), ORIGIN)


def test_geotiff_with_area_or_point_pixels_is_positioned_correctly(tmp_path):
    check(Heightmap(file=tiff(tmp_path, grid()), map_origin_m=ORIGIN).ground(), ORIGIN)
    at_node = (0.0, 0.0, 0.0, EAST, NORTH + CELL * (ROWS - 1), 0.0)
    points = tiff(tmp_path, grid(first=0.0), raster=2, tie=at_node)
    check(Heightmap(file=points, map_origin_m=ORIGIN).ground(), ORIGIN)


def test_grid_without_an_origin_is_centred_at_zero(tmp_path):
    ground = Heightmap(file=tiff(tmp_path, grid())).ground()
    assert ground.extent == (-6.0, 6.0, -4.0, 4.0)
    assert ground.heights == pytest.approx(grid()[::-1], abs=1e-4)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"model": 2}, "cells are in degrees; reproject"),
        ({"tags": False}, "has no north-up position .* gdalwarp"),
        ({"scale": (2.0, 3.0)}, "cells are 2 x 3 m; resample"),
        ({"nodata": "0"}, "^the grid has 1 missing values"),
        ({"nodata": "none"}, "^the NODATA value is not a number"),
        ({"scale": (1e-5, 1e-5)}, "if these are degrees"),
    ],
)
def test_error_for_an_unusable_geotiff_states_a_remedy(tmp_path, keys, message):
    values = grid() - grid()[0, 0]
    with pytest.raises(ScenarioError, match=r"terrain\.file: dem\.tif: ") as caught:
        load_scenario("straight_line", {"terrain": {"kind": "heightmap", "file": tiff(tmp_path, values, **keys)}})
    text = str(caught.value)
    assert re.search(message, text.partition("dem.tif: ")[2])
    assert "\n" not in text


@pytest.mark.parametrize(
    ("tag", "value", "message"),
    [
        (PIXEL_SCALE, (2.0,), "the tags of the map position are damaged"),
        (TIE_POINT, (0.0, 0.0, 0.0, 1e92, 0.0, 0.0), r"the map position \(1e\+92, 0\) m is out of range"),
    ],
)
def test_damaged_map_position_of_a_geotiff_is_rejected(tmp_path, tag, value, message):
    info = TiffImagePlugin.ImageFileDirectory_v2()
    for each, numbers in {PIXEL_SCALE: (2.0, 2.0, 0.0), TIE_POINT: (0.0,) * 6, tag: value}.items():
        info.tagtype[each], info[each] = 12, numbers
    Image.fromarray(np.zeros((4, 4), dtype=np.float32)).save(tmp_path / "dem.tif", tiffinfo=info)
    with pytest.raises(ScenarioError, match=f"dem.tif: {message}; convert the file with gdalwarp"):
        load_scenario("straight_line", {"terrain": {"kind": "heightmap", "file": str(tmp_path / "dem.tif")}})


def test_colour_images_and_other_files_are_rejected_as_geotiff(tmp_path):
    Image.fromarray(np.zeros((4, 4, 3), dtype=np.uint8)).save(tmp_path / "colour.tif")
    (tmp_path / "text.tif").write_text("no image")
    for name, message in (("colour.tif", "one band"), ("text.tif", "is not a TIFF")):
        with pytest.raises(ScenarioError, match=message):
            load_scenario("straight_line", {"terrain": {"kind": "heightmap", "file": str(tmp_path / name)}})


def test_map_origin_for_a_file_without_coordinates_is_rejected(tmp_path):
    np.save(tmp_path / "hill.npy", np.zeros((4, 4)))
    terrain = {"kind": "heightmap", "file": str(tmp_path / "hill.npy"), "map_origin_m": [0.0, 0.0]}
    with pytest.raises(ScenarioError, match=r"terrain.map_origin_m: hill.npy has no coordinates"):
        load_scenario("straight_line", {"terrain": terrain})
