"""Plan files of other programs: sections with direction, speed and working state, in field coordinates."""

import json

import numpy as np
import pytest

shapely = pytest.importorskip("shapely")

from field_shapes import RECTANGLE, default_plan  # noqa: E402

from agrobot_mj.core.errors import ScenarioError  # noqa: E402
from agrobot_mj.core.geodesy import Origin, to_geodetic  # noqa: E402
from agrobot_mj.extensions.fields.field import Field  # noqa: E402
from agrobot_mj.extensions.fields.maps import write_geojson  # noqa: E402
from agrobot_mj.extensions.fields.reading import read_field, read_plan  # noqa: E402

ORIGIN = Origin(52.3, 6.72)
FIELD = Field("Home", shapely.box(0, 0, 200, 100), plane=ORIGIN, crs="EPSG:4326")
OUT, BACK = [(10, 10), (190, 10)], [(190, 16), (10, 16)]


def degrees(points, origin=ORIGIN):
    """Return longitude and latitude of local points [deg]."""
    return [list(to_geodetic(origin, *point)[::-1]) for point in np.array(points, dtype=float).tolist()]


def line(points, **properties):
    return {"type": "Feature", "properties": properties, "geometry": {"type": "LineString", "coordinates": points}}


def plan_of(folder, name, content, field=FIELD):
    (folder / name).write_text(content, encoding="utf-8")
    return read_plan(folder / name, field)[0]


def states(legs):
    return [(leg.working, leg.reverse, leg.speed_m_s) for leg in legs]


def test_geojson_lines_become_plan_legs_with_work_direction_and_speed(tmp_path):
    lines = [
        line(degrees(OUT), speed=2.5, type="swath"),
        line(degrees([OUT[1], BACK[0]]), speed_kmh=3.6, type="turn"),
        line(degrees(BACK), working=True, direction="backward"),
        line(degrees([BACK[1], OUT[0]]), kind="turn"),
    ]
    legs = plan_of(tmp_path, "plan.geojson", json.dumps({"type": "FeatureCollection", "features": lines}))
    assert states(legs) == [(True, False, 2.5), (False, False, 1.0), (True, True, None), (False, False, None)]
    np.testing.assert_allclose(legs[2].points, BACK, atol=1e-3)


def test_plan_table_is_divided_where_work_or_direction_changes(tmp_path):
    rows = [
        (10, 10, 2, "on", 1),
        (100, 10, 2, "on", 1),
        (190, 10, 1, "off", 1),
        (195, 12, 0.5, "off", -1),
        (190, 14, 0, "off", 1),
    ]
    text = "x,y,speed,working,direction\n" + "\n".join(",".join(map(str, row)) for row in rows)
    legs = plan_of(tmp_path, "plan.csv", text)
    assert states(legs) == [(True, False, 2.0), (False, False, 1.0), (False, True, 0.5)]
    assert [leg.points[0].tolist() for leg in legs] == [[10, 10], [190, 10], [195, 12]]
    assert [leg.points[-1].tolist() for leg in legs] == [[190, 10], [195, 12], [190, 14]]


def test_fields2cover_path_is_read_with_turns_and_reverse_legs(tmp_path):
    rows = ["10 10 0 0 2 100 1 1", "110 10 0 0 2 80 1 1", "190 10 0 1.57079632679 1 6 1 2", "190 16 0 0 0.5 10 -1 2"]
    legs = plan_of(tmp_path, "path.txt", "\n".join(rows))
    assert states(legs) == [(True, False, 2.0), (False, False, 1.0), (False, True, 0.5)]
    np.testing.assert_allclose(legs[0].points, [(10, 10), (110, 10), (190, 10)])
    np.testing.assert_allclose(legs[2].points, [(190, 16), (180, 16)], atol=1e-9)


def task_data(inner):
    return f'<ISO11783_TaskData VersionMajor="4"><PFD A="PFD1" C="Home" D="1">{inner}</PFD></ISO11783_TaskData>'


def lsg(points):
    return '<LSG A="5">' + "".join(f'<PNT A="2" C="{y:.9f}" D="{x:.9f}"/>' for x, y in degrees(points)) + "</LSG>"


def test_guidance_patterns_are_cut_at_the_boundary(tmp_path):
    ab, curve = lsg([(50, 30), (60, 30)]), lsg([(20, 50), (60, 55), (90, 50)])
    a_plus = lsg([(80, 40)])
    text = task_data(
        f'<GGP A="GGP1"><GPN A="GPN1" C="1">{ab}</GPN><GPN A="GPN2" C="3">{curve}</GPN>'
        f'<GPN A="GPN3" C="2" G="0">{a_plus}</GPN></GGP>'
    )
    legs = plan_of(tmp_path, "TASKDATA.XML", text)
    np.testing.assert_allclose(np.sort(legs[0].points[:, 0])[[0, -1]], [0, 200], atol=0.05)
    np.testing.assert_allclose(legs[0].points[:, 1], 30, atol=0.05)
    assert len(legs[1].points) == 3
    np.testing.assert_allclose(legs[2].points[:, 0], 80, atol=0.05)
    older = plan_of(tmp_path, "v3.xml", task_data(lsg(OUT)).replace('"4"', '"3"'))
    np.testing.assert_allclose(older[0].points, OUT, atol=0.01)


def test_agopengps_tracks_are_converted_to_the_plane_of_the_field(tmp_path):
    other = Origin(*to_geodetic(ORIGIN, 40.0, 20.0))
    folder = tmp_path / "Home"
    folder.mkdir()
    (folder / "Field.txt").write_text(f"StartFix\n{other.latitude:.8f},{other.longitude:.8f}\n")
    ab = "AB\n0.0\n60.000,-10.000\n60.000,10.000\n0.5\n2\nTrue\n0\n"
    curve = "Curve\n0.0\n0,0\n0,0\n0\n4\nTrue\n2\n-20.000,0.000,0.0\n-20.000,30.000,0.0\n"
    (folder / "TrackLines.txt").write_text(f"$TrackLines\n{ab}{curve}")
    legs, _ = read_plan(folder, FIELD)
    np.testing.assert_allclose(legs[0].points[:, 0], 100.5, atol=0.01)
    np.testing.assert_allclose(np.sort(legs[0].points[:, 1]), [0, 100], atol=0.01)
    np.testing.assert_allclose(legs[1].points, [(20, 20), (20, 50)], atol=0.01)
    (folder / "RecPath.txt").write_text("$RecPath\n3\n0,0,0,7.2,False\n5,0,0,7.2,False\n9,1,0,7.2,False\n")
    ((recorded,), _) = read_plan(folder, FIELD)
    assert recorded.speed_m_s == pytest.approx(2.0)
    np.testing.assert_allclose(recorded.points[0], (40, 20), atol=0.01)


def test_plan_uses_the_coordinate_system_of_the_field_by_default(tmp_path):
    pyproj = pytest.importorskip("pyproj")
    grid = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True).transform
    text = "x,y\n" + "\n".join("{:.3f},{:.3f}".format(*grid(*point)) for point in degrees(OUT))
    (leg,) = plan_of(tmp_path, "plan.csv", text, Field("Home", FIELD.boundary, plane=ORIGIN, crs="EPSG:25832"))
    np.testing.assert_allclose(leg.points, OUT, atol=0.01)
    shifted = Field("Home", FIELD.boundary, shift=(400_000.0, 5_000_000.0))
    (leg,) = plan_of(tmp_path, "b.csv", "x,y\n400010,5000010\n400190,5000010\n", shifted)
    np.testing.assert_allclose(leg.points, OUT)


REJECTED = {
    "far.csv": ("x,y\n50000,10\n50100,10\n", "far.csv: the plan is 49.8 km from the field; use the coordinate system"),
    "ring.json": (
        json.dumps({"type": "Polygon", "coordinates": [[[6.7, 52], [6.8, 52], [6.8, 52.1]]]}),
        "has no lines",
    ),
    "broken.txt": (
        "10 10 0 0 2 100 1 1\n110 10 0 0\n",
        "broken.txt: row 2: the row does not have 8 numbers; save the path again",
    ),
}


@pytest.mark.parametrize("name", REJECTED)
def test_error_for_an_unusable_plan_file_names_the_reason(tmp_path, name):
    content, text = REJECTED[name]
    with pytest.raises(ScenarioError) as error:
        plan_of(tmp_path, name, content)
    assert text in str(error.value)


def test_plan_in_degrees_requires_the_geographic_position_of_the_field(tmp_path):
    with pytest.raises(ScenarioError, match="has geographic coordinates, but the field does not"):
        plan_of(tmp_path, "p.json", json.dumps(line(degrees(OUT))), Field("Home", FIELD.boundary))


def test_plan_of_a_field_without_origin_is_written_and_read_in_metres(tmp_path):
    write_geojson(tmp_path / "plan.geojson", RECTANGLE.boundary, default_plan(RECTANGLE))
    assert read_field(tmp_path / "plan.geojson").boundary.area == pytest.approx(2400.0, rel=1e-6)
