"""Position of a field in the map of its elevation model."""

import re

import numpy as np
import pytest
from field_texts import ORIGIN as ORIGIN_OF_TEXTS
from field_texts import aog, elevation
from PIL import Image, TiffImagePlugin
from scipy.integrate import quad
from shapely import box

from agrobot_mj.core.geodesy import Origin, metres_per_latitude
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.map_position import FILE, KIND, ORIGIN, ground_of, with_terrain
from agrobot_mj.extensions.fields.reading import read_field
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import height_and_gradient
from agrobot_mj.terrain.geotiff import GEO_KEYS

GRID, PLACE = 32632, Origin(52.3, 9.0)  # on the central meridian of the grid, with the easting 500 km
LATITUDE, E2 = np.radians(52.3), 0.00669437999  # Latitude [rad], squared eccentricity of WGS 84
NORTHING = 0.9996 * quad(lambda phi: 6_378_137 * (1 - E2) / (1 - E2 * np.sin(phi) ** 2) ** 1.5, 0.0, LATITUDE)[0]
"""Meridian arc from the equator times the scale of UTM on its central meridian [m]."""


def dem(folder, code=GRID):
    info = TiffImagePlugin.ImageFileDirectory_v2()
    info.tagtype[GEO_KEYS], info[GEO_KEYS] = 3, (1, 1, 0, 1, 3072, 0, 1, code)
    Image.fromarray(np.zeros((2, 2), dtype=np.float32)).save(folder / "dem.tif", tiffinfo=info)
    return {FILE: str(folder / "dem.tif")}


def field(plane=PLACE, crs="EPSG:4326"):
    return Field("farm", box(-50, -50, 50, 50), plane=plane, crs=crs)


def test_field_in_degrees_gets_its_position_in_the_map_of_a_geotiff(tmp_path):
    pytest.importorskip("pyproj")
    given, note = with_terrain(field(), dem(tmp_path))
    assert given[ORIGIN] == pytest.approx([500_000.0, NORTHING], abs=0.01)
    assert (
        note
        == f"the origin of the field is at (500000.0, {given[ORIGIN][1]:.1f}) m in EPSG:32632, the system of dem.tif"
    )


def test_field_in_a_national_grid_gets_its_position_in_this_grid(tmp_path):
    pytest.importorskip("pyproj")
    given, _ = with_terrain(field(crs="EPSG:32632"), {FILE: str(tmp_path / "dem.asc")})
    assert given[ORIGIN] == pytest.approx([500_000.0, NORTHING], abs=0.01)


def test_note_states_the_rotation_of_the_grid(tmp_path):
    pytest.importorskip("pyproj")
    _, note = with_terrain(field(Origin(52.3, 11.5)), dem(tmp_path))
    # meridian convergence: difference of longitude times sin(latitude)
    assert f"turned by {2.5 * np.sin(np.radians(52.3)):.1f} deg" in note.replace("-", "")


@pytest.mark.parametrize(("plane", "code"), [(None, GRID), (PLACE, 32767)])
def test_unknown_map_position_of_a_field_is_reported(tmp_path, plane, code):
    given = dem(tmp_path, code)
    assert with_terrain(field(plane), given) == (
        given,
        "the middle of dem.tif is at the origin of the field; set terrain.map_origin_m for the true position",
    )


@pytest.mark.parametrize("given", [{}, {FILE: "dem.npy"}, {FILE: "dem.tif", ORIGIN: [1.0, 2.0]}, {FILE: "none.tif"}])
def test_terrain_overrides_that_need_no_origin_are_unchanged(given):
    assert with_terrain(field(), given) == (given, "")


def test_recorded_heights_in_the_folder_are_the_terrain_of_a_field(tmp_path):
    start = Origin(ORIGIN_OF_TEXTS.latitude + 0.001, ORIGIN_OF_TEXTS.longitude)
    elevation(aog(tmp_path / "farm"), lambda x, y: 20.0 + 0.05 * x - 0.03 * y, origin=start)
    given, note = with_terrain(read_field(tmp_path / "farm"), {"machine": "row_crop"})
    assert (given[KIND], given["machine"], note) == ("heightmap", "row_crop", "")
    # the origin of the field is 0.001 deg south of the start fix of the heights
    assert given[ORIGIN] == pytest.approx([0.0, -metres_per_latitude(start.latitude) / 1000], abs=0.001)
    ground = ground_of(read_field(tmp_path / "farm"), given)[0]
    for x, y in ((0.0, 0.0), (100.0, -50.0)):
        assert height_and_gradient(ground, x, y) == pytest.approx((20.0 + 0.05 * x - 0.03 * y, 0.05, -0.03), abs=0.02)


@pytest.mark.parametrize("given", [{KIND: "flat"}, {KIND: "slope"}, {"terrain": {"kind": "flat"}}])
def test_given_terrain_replaces_recorded_heights(tmp_path, given):
    elevation(aog(tmp_path / "farm"), lambda x, y: 0.05 * x)
    assert with_terrain(read_field(tmp_path / "farm"), given) == (given, "")


def test_scenario_of_a_plan_reads_a_copy_of_the_recorded_heights(tmp_path, call):
    folder = elevation(aog(tmp_path / "farm"), lambda x, y: 0.05 * x)
    assert call("field", "plan", folder, "--width", "12", "--out", tmp_path / "plan")[0] == 0
    (folder / "Elevation.txt").unlink()
    ground = load_scenario(str(tmp_path / "plan" / "scenario.toml")).terrain.ground()
    assert height_and_gradient(ground, 10.0, 20.0) == pytest.approx((0.5, 0.05, 0.0), abs=0.02)


def test_recorded_heights_of_another_field_are_omitted(tmp_path):
    folder = elevation(aog(tmp_path / "farm"), lambda x, y: 0.05 * x)
    fix = f"{ORIGIN_OF_TEXTS.latitude:.8f}"
    (folder / "Field.txt").write_text((folder / "Field.txt").read_text().replace(fix, "58.40800000"))
    given, note = with_terrain(read_field(folder), {})
    assert (given, note) == ({}, "the ground is level, because Elevation.txt does not cover the field")


@pytest.mark.parametrize(("end", "away"), [(150.0, None), (145.0, None), (120.0, 30.0), (0.0, 150.0)])
def test_note_states_the_distance_of_the_field_from_measured_heights(tmp_path, end, away):
    folder = elevation(aog(tmp_path / "farm"), lambda x, y: 0.05 * x)
    head, title, rows = (folder / "Elevation.txt").read_text().partition("Roll\n")
    kept = [row for row in rows.splitlines() if float(row.split(",")[4]) <= end]
    (folder / "Elevation.txt").write_text(head + title + "\n".join(kept) + "\n")
    _, note = with_terrain(read_field(folder), {})
    if away is None:
        assert note == ""
    else:
        found = re.fullmatch(r"parts of .* up to (\d+) m from the nearest measured height, at \(150, .*\) m", note)
        assert float(found[1]) == pytest.approx(away, abs=2.0)


def test_boundary_in_metres_is_placed_at_the_start_fix_with_a_note(tmp_path):
    folder = elevation(aog(tmp_path / "farm"), lambda x, y: 0.05 * x)
    rows = "x,y\n-150,-80\n150,-80\n150,80\n-150,80\n"
    (tmp_path / "edge.csv").write_text(rows)
    field = read_field(tmp_path / "edge.csv")
    given, note = with_terrain(field, {KIND: "heightmap", FILE: str(folder / "Elevation.txt")})
    assert note == "the coordinates of the field are assumed to be relative to the start fix in Elevation.txt"
    assert given[ORIGIN] == [0.0, 0.0]
    (folder / "edge.txt").write_text(rows)
    assert read_field(folder / "edge.txt").notes == (
        "the coordinates are assumed to be relative to the start fix in Field.txt",
    )


def test_heights_in_a_subfolder_are_not_those_of_another_field(tmp_path):
    elevation(aog(tmp_path / "farm"), lambda x, y: 0.05 * x)
    assert read_field(tmp_path).elevation == tmp_path / "farm" / "Elevation.txt"
    (tmp_path / "edge.csv").write_text("x,y\n-150,-80\n150,-80\n150,80\n-150,80\n")
    assert read_field(tmp_path).elevation is None


def test_bicycle_plant_works_on_level_ground(tmp_path):
    elevation(aog(tmp_path / "farm"), lambda x, y: 0.05 * x)
    given = {"plant.kind": "bicycle"}
    assert with_terrain(read_field(tmp_path / "farm"), given) == (given, "")


@pytest.mark.parametrize("comma", [".", ","])
def test_recorded_heights_far_from_the_start_fix_match_the_boundary(tmp_path, comma):
    folder = elevation(aog(tmp_path / "farm", comma), lambda x, y: 20.0 + 0.05 * x, origin=Origin(58.37, 26.7))
    start = f"{ORIGIN_OF_TEXTS.latitude:.8f};{ORIGIN_OF_TEXTS.longitude:.8f}".replace(".", comma).replace(";", ",")
    far = "58.37000000;26.70000000".replace(".", comma).replace(";", ",")  # 3.3 km south of the field
    north = (ORIGIN_OF_TEXTS.latitude - 58.37) * metres_per_latitude(58.37)
    (folder / "Field.txt").write_text((folder / "Field.txt").read_text().replace(start, far))
    for name in ("Boundary.txt", "Headland.txt"):
        lines = (folder / name).read_text().splitlines()
        moved = [_moved(line, north, comma) for line in lines]
        (folder / name).write_text("\n".join(moved) + "\n")
    field = read_field(folder)
    given, note = with_terrain(field, {})
    assert note == ""
    east, middle = field.boundary.centroid.x, field.boundary.centroid.y
    ground = ground_of(field, given)[0]
    slope = height_and_gradient(ground, east, middle)
    edge = height_and_gradient(ground, field.boundary.bounds[0], middle)
    assert slope[1] == pytest.approx(0.05, abs=0.002)
    assert edge[0] == pytest.approx(20.0 + 0.05 * -150.0, abs=0.05)


def _moved(line, north, comma):
    """Return a row of a boundary file with its point moved to the north [m]."""
    cells = line.split(",")
    if len(cells) < 3:
        return line
    if comma == ",":
        x, y = f"{cells[0]}.{cells[1]}", f"{cells[2]}.{cells[3]}"
        return f"{x};{float(y) + north:.3f};0.00000".replace(".", ",").replace(";", ",")
    return f"{cells[0]},{float(cells[1]) + north:.3f},{cells[2]}"
