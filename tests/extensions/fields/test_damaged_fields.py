"""Damaged and hostile field files: reported repairs, and error messages."""

import json
import zipfile

import numpy as np
import pytest

pytest.importorskip("shapely")

from field_texts import FILES, HOLE, ORIGIN, RING, degrees, feature, field_of, geojson, task_data

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.fields.reading import read_field, read_plan


def metres(ring):
    return "x,y\n" + "\n".join(f"{x:.3f},{y:.3f}" for x, y in ring)


BOW = [(0, 0), (100, 100), (100, 0), (0, 60)]
LOOP = [(0, 0), (200, 0), (200, 100), (203, 103), (203, 100), (190, 105), (0, 100)]
"""Self-intersecting rings: one encloses two large areas, the other has a loop of 3 m2 at a corner."""
REPAIRED = {
    "repeated points": (metres(np.repeat(RING, 2, axis=0)), 45_400, "5 repeated points of the boundary are omitted"),
    "a point 1 km off": (metres([*RING, (200, 1200)]), 45_400, "point 6 of the boundary is omitted, because it is 1"),
    "a loop": (
        metres(LOOP),
        20_506.4,
        "the boundary crosses itself at (200.8, 100.8) m between points 3-4 and 5-6 and is repaired, without 3.25 m2",
    ),
    "two areas that touch": (
        metres([(0, 0), (200, 0), (200, 100), (0, 100), (-80, 180), (-80, 100), (0, 100)]),
        20_000,
        "the boundary touches itself at (0.0, 100.0) m and is repaired, without 3200.00 m2 of 23200 m2",
    ),
    "a line out and back": (
        metres([*RING, (-150, 900)]),
        45_400,
        "point 6 of the boundary is omitted, because the boundary turns back over",
    ),
    "a spike": (
        metres([*RING[:2], (900, -20), *RING[2:]]),
        45_400 + 45_000,
        "point 3 of the boundary is the tip of a spike of 9 deg and 752 m; check it",
    ),
    "two laps": (metres([*RING, RING[0], *(0.98 * RING)]), 45_400, "a second outline of the field is omitted"),
    "a crossed hole": (
        geojson(feature(degrees(RING), degrees([(0, 0), (20, 20), (20, 0), (0, 20)]))),
        45_200,
        "the hole crosses itself at (10.0, 10.0) m between points 1-2 and 3-4; all parts are kept",
    ),
    "a crossed obstacle": (
        geojson(feature(degrees(RING)), feature(degrees([(0, 0), (20, 20), (20, 0), (0, 20)]))),
        45_200,
        "the obstacle crosses itself at (10.0, 10.0) m",
    ),
    "a hole outside": (
        geojson(feature(degrees(RING), degrees(HOLE + [500, 0]))),
        45_400,
        "1 hole outside the boundary is omitted",
    ),
    "a hole across": (
        geojson(feature(degrees(RING), degrees(HOLE + [140, 0]))),
        45_250,
        "1 hole is cut at the boundary",
    ),
    "a far origin": (
        metres(RING + [5_000_000, 60_000]),
        45_400,
        "(5000000, 60000) m is subtracted from all coordinates",
    ),
    "swapped axes": (
        geojson(feature([[y, x + 70] for x, y in degrees(RING)])),
        45_400,
        "the positions are read as latitude, longitude",
    ),
    "another line": (
        metres([*RING, RING[0], (500, 500), (600, 500), (600, 510)]),
        45_400,
        "the largest of 2 fields is used",
    ),
}


@pytest.mark.parametrize("name", REPAIRED)
def test_damaged_field_boundary_is_repaired_and_reported(tmp_path, name):
    text, area, note = REPAIRED[name]
    field = field_of(tmp_path, "field.txt", text)
    assert field.boundary.area == pytest.approx(area, rel=1e-3)
    assert field.boundary.is_valid
    assert any(each.startswith(note) for each in field.notes), field.notes


@pytest.mark.parametrize("extra", [[(200, 1200)], [(-150, 2000)]])
def test_omitted_boundary_points_do_not_displace_the_field_origin(tmp_path, extra):
    for file, text in (
        ("far.json", geojson(feature(degrees([*RING, *extra])))),
        ("hole.json", geojson(feature(degrees(RING), degrees(HOLE + extra[0])))),
        ("grid.csv", metres(np.array([*RING, *extra]) + [5e6, 6e4])),
    ):
        field = field_of(tmp_path, file, text)
        west, south, east, north = field.boundary.bounds
        assert (west + east, south + north) == pytest.approx((0, 0), abs=1.0)
        assert field.plane is None or field.plane == pytest.approx(ORIGIN, abs=1e-6)
        assert len(field.notes) == len(set(field.notes)) > 0


def test_obstacle_smaller_than_a_machine_is_kept(tmp_path):
    pole = [(0, 0), (1, 0), (1, 1), (0, 1)]
    (obstacle,) = field_of(tmp_path, "pole.json", geojson(feature(degrees(RING)), feature(degrees(pole)))).obstacles
    assert obstacle.area == pytest.approx(1.0, rel=1e-3)


def test_field_boundary_from_an_open_line_is_closed_and_reported(tmp_path):
    text = json.dumps({"type": "LineString", "coordinates": degrees(RING)[:-1]})
    field = field_of(tmp_path, "line.json", text)
    assert field.notes == ("the file has no closed ring; the ends of a line are joined to form the boundary",)
    assert field.boundary.area == pytest.approx(45_400, rel=2e-4)
    closed = json.dumps({"type": "LineString", "coordinates": degrees(RING)})
    assert field_of(tmp_path, "closed.json", closed).notes == ()


SCRAPS = (b"nan", b"1e999", b"-1", b"", b"null", b"\xff", b"<", b"{", b",", b"1e300", b"\x00", b"\n")
"""Bytes that replace a part of a file."""


@pytest.mark.parametrize("name", FILES)
def test_randomly_changed_field_file_gives_a_field_or_one_line_message(tmp_path, name):
    chance, content, said = np.random.default_rng(3), FILES[name].encode(), list[str]()
    for _ in range(30):
        start = int(chance.integers(len(content)))
        end = start + int(chance.choice([0, 1, 5, 40]))
        scrap = SCRAPS[chance.integers(len(SCRAPS))]
        (tmp_path / name).write_bytes(content[:start] + scrap + content[end:])
        try:
            field = read_field(tmp_path / name)
        except ScenarioError as error:
            said.append(str(error))
            continue
        assert field.boundary.is_valid
        assert field.boundary.area > 0
    assert said
    assert all("\n" not in line and line.startswith(name) for line in said), said


END = b"PK\x05\x06\0\0\0\0\1\0\1\0\x20\0\0\0\0\0\0\0\0\0"
"""End record of a zip archive whose directory of one file precedes the record."""
HOSTILE = {
    "empty": (b"", "the file is empty; create the file again"),
    "blank": (b"\n \n\n", "the file contains no positions; export the file again"),
    "a bow": (
        metres(BOW).encode(),
        "the boundary crosses itself at (37.5, 37.5) m between points 1-2 and 3-4; the largest part covers 3125",
    ),
    "a hole around": (geojson(feature(degrees(RING), degrees(2 * RING))).encode(), "the holes cover the whole field"),
    "decimal commas": (b"lat,lon\n52,31,6,72\n52,31,6,73\n", "write decimal points instead of decimal commas"),
    "six columns": (b"1,2.5,3,4,5,6\n2,2.5,3,4,5,6\n", "the row has 6 columns; write x, y or x, y, speed"),
    "decimal commas without names": (b"52,31,6,72\n52,31,6,73\n", "write decimal points instead of decimal commas"),
    "decimal commas in KML": (
        b"<kml><Placemark><LineString><coordinates>6,72,52,31 6,73,52,31</coordinates></LineString></Placemark></kml>",
        "a position is not longitude,latitude",
    ),
    "binary": (bytes(range(256)) * 20, "the file is not text, or contains null bytes; save it as CSV"),
    "zip": (b"PK\x05\x06" + b"\0" * 18, "the folder contains no field; specify a folder with TASKDATA.XML"),
    "damaged zip": (b"PK" * 20 + END, "the zip archive is damaged or encrypted"),
    "a huge integer": (
        geojson(feature([[0, 0], [1, 0], [1, 10**400]])).encode(),
        "position 3, (1, inf), is out of range",
    ),
    "not a number": (b"x,y\n0,0\n9,nan\n9,9\n", "row 3: y is nan; use a finite number"),
    "two points": (b"x,y\n0,0\n9,9\n", "the boundary needs at least 3 different points, got 2"),
    "flat": (b"x,y\n0,0\n50,0\n99,0\n", "the boundary encloses 0 m2, less than 10"),
    "a line of task data": (b'<ISO11783_TaskData VersionMajor="4"/>', "the file contains no boundary; export one"),
    "point without a place": (
        task_data("").replace(' C="', ' Q="').encode(),
        "has a point PNT without the numbers C and D",
    ),
    "unknown text": (b"POLYGON ((0 0, 1", "line 1: the line is not valid WKT"),
    "random points": (
        metres(np.random.default_rng(2).uniform(0, 100, (4000, 2))).encode(),
        "the boundary crosses itself at more than 1000 places; sort the points",
    ),
    "degrees as metres": (b"58.4,26.7\n58.401,26.7\n58.401,26.701\n", "if the numbers are degrees, name the columns"),
    "half a planet": (
        json.dumps({"type": "Polygon", "coordinates": [[[0, 0], [90, 0], [0, 60]]]}).encode(),
        "extend over",
    ),
    "nested": (b"[" * 200_000, "is not valid JSON"),
    "entities": (b'<!DOCTYPE a [<!ENTITY b "c">]><kml>&d;</kml>', "is not valid XML"),
    "null geometry": (
        b'{"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": null}]}',
        "no boundary",
    ),
}


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_damaged_zip_archive_is_rejected_with_every_compression(tmp_path, method):
    file = tmp_path / "farm.zip"
    with zipfile.ZipFile(file, "w", method) as archive:
        archive.writestr("a.kml", FILES["a.kml"])
    content = bytearray(file.read_bytes())
    content[60:80] = bytes(20)
    file.write_bytes(content)
    with pytest.raises(ScenarioError, match=r"farm\.zip: the zip archive is damaged or encrypted; create the archive"):
        read_field(file)


@pytest.mark.parametrize("name", HOSTILE)
def test_malicious_field_file_gives_one_message_with_the_file_name(tmp_path, name):
    content, text = HOSTILE[name]
    (tmp_path / "field.dat").write_bytes(content)
    with pytest.raises(ScenarioError) as error:
        read_field(tmp_path / "field.dat")
    assert text in str(error.value)
    assert "\n" not in str(error.value)


def test_field_across_the_antimeridian_has_one_boundary(tmp_path):
    ring = [[179.999, -17], [-179.999, -17], [-179.999, -16.999], [179.999, -16.999]]
    field = field_of(tmp_path, "fiji.json", json.dumps({"type": "Polygon", "coordinates": [ring]}))
    assert field.boundary.area == pytest.approx(212.98 * 110.65, rel=1e-3)
    assert abs(field.plane.longitude) == pytest.approx(180)
    for ends in ([179.9992, -179.9992], [179.9998, 179.9992], [-179.9998, -179.9992]):
        line = json.dumps({"type": "LineString", "coordinates": [[lon, -16.9995] for lon in ends]})
        (tmp_path / "plan.json").write_text(line)
        ((leg,), _) = read_plan(tmp_path / "plan.json", field)
        east = [(lon % 360 - 180) * 106_486 for lon in ends]
        assert leg.points[:, 0] == pytest.approx(east, rel=1e-3)
        assert leg.points[:, 1] == pytest.approx([0.0, 0.0], abs=0.1)


def test_boundary_with_many_points_is_simplified(tmp_path):
    angle = np.linspace(0, 2 * np.pi, 200_000, endpoint=False)
    field = field_of(tmp_path, "round.csv", metres(np.column_stack([100 * np.cos(angle), 100 * np.sin(angle)])))
    assert field.boundary.area == pytest.approx(np.pi * 1e4, rel=5e-4)
    assert len(field.boundary.exterior.coords) < 1000
    assert field.notes[0].startswith("the boundary is simplified within 0.057 m, from 200000 to ")


def test_boundary_with_points_closer_than_a_millimetre_is_kept(tmp_path):
    angle = np.linspace(0, 2 * np.pi, 100_000, endpoint=False)
    rows = (f"{x:.5f},{y:.5f}" for x, y in np.column_stack([5 * np.cos(angle), 5 * np.sin(angle)]).tolist())
    field = field_of(tmp_path, "dense.csv", "x,y\n" + "\n".join(rows))
    assert field.boundary.area == pytest.approx(np.pi * 25, rel=2e-3)
    assert "repeated points of the boundary are omitted" in field.notes[0]


def test_hole_that_ends_outside_the_boundary_leaves_no_sliver(tmp_path):
    outer = [(-60.12, -55.0), (60.12, -55.0), (60.12, 35.0), (0.0, 55.0), (-60.12, 35.0)]
    hole = [(40.0, -15.0), (80.0, -15.0), (80.0, 5.0), (40.0, 5.0)]
    boundary = field_of(tmp_path, "cut.json", geojson(feature(degrees(outer), degrees(hole)))).boundary
    whole = field_of(tmp_path, "whole.json", geojson(feature(degrees(outer)))).boundary
    assert boundary.length == pytest.approx(whole.length + 2 * 20.12, rel=1e-3)
