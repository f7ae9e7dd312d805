"""Command `field show`: description of a field, its map, and messages."""

import json
import math

import pytest

pytest.importorskip("shapely")

from field_texts import RING, aog, degrees, elevation

TEXT = "x,y\n0,0\n100,0\n100,100\n50,20\n0,100\n0,100\n"
"""Field of 0.6 ha with a notch and a repeated point."""


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "home.csv").write_text(TEXT)
    return "home.csv"


def test_field_show_prints_area_corners_and_repairs(call, file, tmp_path):
    status, out, err = call("field", "show", file, "--out", "found")
    assert (status, err) == (0, "")
    first, corners, problem, picture = out.splitlines()
    assert first == "home: 0.6 ha, perimeter 489 m"
    assert corners == "5 sharp corners of up to 148 deg at (100.0, 100.0) m"
    assert problem == "problem: 1 repeated point of the boundary is omitted"
    assert picture == "found/map.png"
    assert (tmp_path / "found" / "map.png").read_bytes().startswith(b"\x89PNG")


def test_field_show_prints_a_single_sharp_corner_in_singular(call, file, tmp_path):
    angle = [0.1 * k for k in range(32)]
    drop = [(0.0, -90.0), *((50 * math.cos(a), 50 * math.sin(a)) for a in angle)]
    (tmp_path / "drop.csv").write_text("x,y\n" + "\n".join(f"{x:.2f},{y:.2f}" for x, y in drop))
    _, out, _ = call("field", "show", "drop.csv", "--out", "found")
    assert out.splitlines()[1] == "1 sharp corner of 122 deg at (0.0, -90.0) m"


def test_field_show_prints_a_json_document_on_success_and_failure(call, file):
    status, out, _ = call("field", "show", file, "--json")
    document = json.loads(out)
    assert (status, document["command"], document["area_m2"]) == (0, "field show", pytest.approx(6000))
    assert document["folder"] == "runs/field-home"
    status, out, err = call("field", "show", "nowhere.csv", "--json")
    document = json.loads(out)
    assert (status, document["command"], document["error"]) == (2, "field show", err.strip())
    assert err == "nowhere.csv: no such file; specify an existing file\n"


def test_field_command_without_a_subcommand_lists_the_subcommands(call):
    status, _, err = call("field")
    assert status == 2
    assert "field: specify one of its commands: field show" in err


def test_help_of_the_field_command_describes_its_subcommands(call):
    status, out, err = call("field", "--help")
    assert (status, err) == (0, "")
    assert [line[:12].rstrip() for line in out.splitlines()] == [
        "field show",
        "field plan",
        "field run",
        "field compar",
    ]
    assert "Plan headland laps, swaths and turns" in out


def test_field_command_writes_nothing_for_an_invalid_file(call, file, tmp_path):
    (tmp_path / file).write_text("x,y\n0,0\n")
    status, out, err = call("field", "show", file, "--out", "found")
    need = "the boundary needs at least 3 different points, got 1; add its corners"
    assert (status, out, err) == (2, "", f"home.csv: {need}\n")
    assert not (tmp_path / "found").exists()


@pytest.mark.parametrize("arguments", [("show", ""), ("plan", "  "), ("run", "home.csv", "--plan", "")])
def test_blank_field_file_name_is_rejected(call, file, arguments):
    status, out, err = call("field", *arguments)
    assert (status, out) == (2, "")
    assert "an argument is blank" in " ".join(err.split())


def test_incomplete_price_is_rejected_before_planning(call, file):
    assert call("field", "run", file, "--price", "seed=3")[::2] == (
        2,
        "--price seed=3: the name must be one of input_ha, yield_ha, hour; the value must be at least 0\n",
    )


def shown(call, *words):
    status, out, err = call("field", "show", *words, "--json")
    assert (status, err) == (0, "")
    return json.loads(out)


def test_slope_of_a_given_plane_is_printed_with_its_direction(call, file):
    keys = ("terrain.kind=slope", "terrain.grade_deg=6", "terrain.direction_deg=45")
    sets = [word for key in keys for word in ("--set", key)]
    slope = shown(call, file, *sets)["slope"]
    assert [slope[key] for key in ("mean_deg", "max_deg")] == pytest.approx([6.0, 6.0])
    assert slope["falls_to_deg"] == pytest.approx(-135.0)
    rise = math.tan(math.radians(6)) * 100 * math.sqrt(2)
    assert slope["highest_m"] - slope["lowest_m"] == pytest.approx(rise, rel=0.03)  # nodes 2 m apart
    assert "mean slope 6.0 deg, falling to the south-west; maximum 6.0 deg" in call("field", "show", file, *sets)[1]


def test_recorded_heights_of_a_hill_give_its_maximum_slope(call, tmp_path):
    folder = elevation(aog(tmp_path / "farm"), lambda x, y: 80.0 + 5.0 * math.exp(-(x * x + y * y) / (2 * 40.0**2)))
    slope = shown(call, folder, "--out", tmp_path / "out")["slope"]
    steepest = math.degrees(math.atan(5.0 / (40.0 * math.sqrt(math.e))))  # at one standard deviation from the top
    assert slope["max_deg"] == pytest.approx(steepest, rel=0.05)
    assert math.hypot(slope["max_x_m"], slope["max_y_m"]) == pytest.approx(40.0, abs=6.0)
    assert slope["falls_to_deg"] is None
    assert slope["notes"] == ["heights are interpolated from 1616 of 1616 points, with a cell size of 2 m"]


def test_level_ground_replaces_recorded_heights_on_request(call, tmp_path):
    folder = elevation(aog(tmp_path / "farm"), lambda x, y: 0.1 * x)
    _, out, _ = call("field", "show", folder, "--set", "terrain.kind=flat", "--out", tmp_path / "out")
    assert "level ground" in out.splitlines()


def test_unusable_recorded_heights_are_reported_as_a_problem(call, tmp_path):
    folder = elevation(aog(tmp_path / "farm"), lambda x, y: 0.1 * x, quality=8)
    found = shown(call, folder, "--out", tmp_path / "out")
    assert found["slope"] is None
    assert "the ground is level, because of Elevation.txt: the file has 0 of 1616 points with an RTK fix" in str(
        found["notes"]
    )


def test_elevation_file_without_points_is_ignored(call, tmp_path):
    folder = elevation(aog(tmp_path / "farm"), lambda x, y: 0.0)
    text = (folder / "Elevation.txt").read_text()
    (folder / "Elevation.txt").write_text(text[: text.index("Roll") + 5])
    found = shown(call, folder, "--out", tmp_path / "out")
    assert (found["slope"], found["notes"]) == (None, [])


@pytest.mark.parametrize("suffix", ["geojson", "kml"])
def test_heights_of_the_boundary_give_the_slope_of_the_field(call, tmp_path, suffix):
    heights = [*(30.0 + 0.05 * x - 0.02 * y for x, y in RING), 30.0 + 0.05 * -150 - 0.02 * -80]
    ring = [[*place, height] for place, height in zip(degrees(RING), heights, strict=True)]
    text = json.dumps({"type": "Polygon", "coordinates": [ring]})
    if suffix == "kml":
        places = " ".join(",".join(map(str, place)) for place in ring)
        boundary = f"<outerBoundaryIs><LinearRing><coordinates>{places}</coordinates></LinearRing></outerBoundaryIs>"
        text = f"<kml><Placemark><Polygon>{boundary}</Polygon></Placemark></kml>"
    (tmp_path / f"a.{suffix}").write_text(text)
    slope = shown(call, tmp_path / f"a.{suffix}", "--out", tmp_path / "out")["slope"]
    assert slope["mean_deg"] == pytest.approx(math.degrees(math.atan(math.hypot(0.05, 0.02))), rel=0.05)
    assert slope["falls_to_deg"] == pytest.approx(math.degrees(math.atan2(0.02, -0.05)), abs=3.0)
    assert slope["notes"] == ["the slope is computed from the boundary"]


def test_equal_heights_of_the_boundary_give_no_slope(call, tmp_path):
    text = json.dumps({"type": "Polygon", "coordinates": [[[*place, 0] for place in degrees(RING)]]})
    (tmp_path / "a.geojson").write_text(text)
    assert shown(call, tmp_path / "a.geojson", "--out", tmp_path / "out")["slope"] is None


def test_invalid_terrain_of_a_field_is_rejected_with_the_fix(call, file):
    words = ("--set", "terrain.kind=heightmap", "--set", "terrain.file=none.tif")
    status, out, err = call("field", "show", file, *words)
    assert (status, out) == (2, "")
    assert err.startswith("terrain.file: none.tif: no such file in ")


def test_terrain_that_does_not_cover_the_field_is_reported(call, file):
    sets = ("--set", "terrain.kind=slope", "--set", "terrain.grade_deg=6", "--set", "terrain.half_size_m=60")
    assert shown(call, file, *sets)["slope"]["notes"] == ["the terrain does not cover the whole field"]


def test_contour_lines_are_drawn_at_their_heights(tmp_path):
    import numpy as np
    from shapely import box

    from agrobot_mj.extensions.fields.describe import draw_field
    from agrobot_mj.extensions.fields.field import Field
    from agrobot_mj.extensions.fields.slope import relief_of
    from agrobot_mj.terrain.grid import plane

    boundary = box(-50.0, -20.0, 50.0, 20.0)
    axes = draw_field(Field("a", boundary), relief_of(boundary, plane(0.05, 0.0, 200.0))).axes[0]
    (lines,) = (each for each in axes.collections if hasattr(each, "levels"))
    assert lines.levels.tolist() == pytest.approx(np.arange(-2.5, 2.5, 0.5).tolist())
    for level, path in zip(lines.levels, lines.get_paths(), strict=True):
        assert path.vertices[:, 0] == pytest.approx(level / 0.05)
