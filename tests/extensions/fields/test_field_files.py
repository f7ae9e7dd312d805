"""Fields from every format: the same polygon, repairs that are reported, and messages for hostile files."""

import json
import zipfile

import numpy as np
import pytest

shapely = pytest.importorskip("shapely")

from agrobot_mj.core.errors import ScenarioError  # noqa: E402
from agrobot_mj.core.geodesy import Origin, to_geodetic  # noqa: E402
from agrobot_mj.extensions.fields.reading import read_field  # noqa: E402

ORIGIN = Origin(58.4, 26.7)
RING = np.array([(-150, -80), (150, -80), (150, 40), (20, 80), (-150, 80)], dtype=float)
HOLE = np.array([(0, 0), (20, 0), (20, 15), (0, 15)], dtype=float)
"""Boundary and hole [m]; the middle of the bounding box is at (0, 0)."""
AREA = 45_400.0 - 300.0  # Area of the boundary without the hole [m2], from the shoelace formula


def degrees(ring):
    """Longitude and latitude of a closed ring [deg]."""
    return [list(to_geodetic(ORIGIN, *point)[::-1]) for point in np.array([*ring, ring[0]]).tolist()]


def text_of(ring, form="{:.9f},{:.9f}", between=" "):
    return between.join(form.format(*point) for point in degrees(ring))


def feature(*rings, **properties):
    return {"type": "Feature", "properties": properties, "geometry": {"type": "Polygon", "coordinates": [*rings]}}


def geojson(*features, **more):
    return json.dumps({"type": "FeatureCollection", "features": [*features], **more})


def lsg(kind, ring):
    return f'<LSG A="{kind}">' + "".join(f'<PNT A="2" C="{y:.9f}" D="{x:.9f}"/>' for x, y in degrees(ring)) + "</LSG>"


def task_data(inner, version=4, more=""):
    field = f'<PFD A="PFD1" C="North" D="1"><PLN A="1">{lsg(1, RING)}{inner}</PLN>{more}</PFD>'
    return (
        f'<?xml version="1.0"?><ISO11783_TaskData VersionMajor="{version}" VersionMinor="0">{field}</ISO11783_TaskData>'
    )


def kml_ring(tag, ring):
    return f"<{tag}><LinearRing><coordinates>{text_of(ring, '{:.9f},{:.9f},0')}</coordinates></LinearRing></{tag}>"


GML3 = (
    '<f xmlns:gml="http://www.opengis.net/gml/3.2"><gml:Polygon srsName="urn:ogc:def:crs:EPSG::4326">'
    "{}</gml:Polygon></f>"
)
GML2 = '<f xmlns:gml="http://www.opengis.net/gml"><gml:Polygon srsName="EPSG:4258">{}</gml:Polygon></f>'


def gml3(tag, ring):
    numbers = " ".join(f"{y:.9f} {x:.9f}" for x, y in degrees(ring))
    return f"<gml:{tag}><gml:LinearRing><gml:posList>{numbers}</gml:posList></gml:LinearRing></gml:{tag}>"


def gml2(tag, ring):
    inner = f"<gml:coordinates>{text_of(ring)}</gml:coordinates>"
    return f"<gml:{tag}><gml:LinearRing>{inner}</gml:LinearRing></gml:{tag}>"


WKT = f"POLYGON (({text_of(RING, '{:.9f} {:.9f}', ', ')}), ({text_of(HOLE, '{:.9f} {:.9f}', ', ')}))"
LAT_LON = "lat,lon\n" + "\n".join(f"{y:.9f},{x:.9f}" for ring in (RING, HOLE) for x, y in degrees(ring))
FILES = {
    "a.geojson": geojson(feature(degrees(RING), degrees(HOLE), name="North")),
    "fiboa.json": geojson(feature(degrees(RING), degrees(HOLE)), fiboa_version="0.3.0"),
    "obstacle.geojson": geojson(feature(degrees(RING)), feature(degrees(HOLE))),
    "bare.json": json.dumps({"type": "MultiPolygon", "coordinates": [[degrees(RING), degrees(HOLE)]]}),
    "a.kml": '<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><Polygon>'
    f"{kml_ring('outerBoundaryIs', RING)}{kml_ring('innerBoundaryIs', HOLE)}</Polygon></Placemark></kml>",
    "gml3.gml": GML3.format(gml3("exterior", RING) + gml3("interior", HOLE)),
    "gml2.xml": GML2.format(gml2("outerBoundaryIs", RING) + gml2("innerBoundaryIs", HOLE)),
    "a.wkt": WKT,
    "z.wkt": f"SRID=4326;{WKT}",
    "v4.xml": task_data(lsg(2, HOLE)),
    "v3.xml": task_data("", 3, f'<PLN A="6">{lsg(1, HOLE)}</PLN>'),
    "two_rings.csv": LAT_LON,
}


def field_of(folder, name, content, **options):
    """The field of a file with this content."""
    (folder / name).write_text(content, encoding="utf-8")
    return read_field(folder / name, **options)


@pytest.mark.parametrize("name", FILES)
def test_every_field_file_format_gives_the_same_field(tmp_path, name):
    field = field_of(tmp_path, name, FILES[name])
    assert field.boundary.area == pytest.approx(AREA, rel=2e-4)
    assert len(field.boundary.interiors) == 1
    assert field.boundary.symmetric_difference(shapely.Polygon(RING, [HOLE])).area < 20
    assert field.plane == pytest.approx(ORIGIN, abs=1e-6)
    assert field.notes == ()


def test_obstacles_are_read_from_areas_and_from_boundary_holes(tmp_path):
    for name in ("v3.xml", "obstacle.geojson"):
        (obstacle,) = field_of(tmp_path, name, FILES[name]).obstacles
        assert obstacle.area == pytest.approx(300, rel=1e-3)


def test_file_with_projected_coordinates_gives_the_same_field(tmp_path):
    pyproj, shapefile = pytest.importorskip("pyproj"), pytest.importorskip("shapefile")
    grid = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:3301", always_xy=True).transform
    rings = [[grid(*point) for point in degrees(ring)] for ring in (RING, HOLE)]
    with shapefile.Writer(str(tmp_path / "farm.shp"), shapeType=shapefile.POLYGON) as writer:
        writer.field("NAME", "C")
        writer.poly([rings[0][::-1], rings[1]])
        writer.record("North")
    (tmp_path / "farm.prj").write_text(pyproj.CRS("EPSG:3301").to_wkt("WKT1_ESRI"))
    table = "easting;northing\n" + "\n".join(f"{x:.3f};{y:.3f}".replace(".", ",") for ring in rings for x, y in ring)
    feature_grid = geojson(feature(*rings), crs={"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3301"}})
    urn = GML3.replace("4326", "3301").format(
        "".join(
            f"<gml:{tag}><gml:LinearRing><gml:posList>{' '.join(f'{y} {x}' for x, y in ring)}</gml:posList>"
            f"</gml:LinearRing></gml:{tag}>"
            for tag, ring in zip(("exterior", "interior"), rings, strict=True)
        )
    )
    for field in (
        read_field(tmp_path / "farm.shp"),
        field_of(tmp_path, "grid.csv", table, crs="EPSG:3301"),
        field_of(tmp_path, "grid.json", feature_grid),
        field_of(tmp_path, "grid.gml", urn),
    ):
        assert field.boundary.area == pytest.approx(AREA, rel=3e-4)
        assert field.plane == pytest.approx(ORIGIN, abs=1e-5)
        assert field.crs == "EPSG:3301"
    assert read_field(tmp_path / "farm.shp").name == "North"


def aog(folder, comma="."):
    """A field folder of AgOpenGPS with boundary, hole and headland."""
    folder.mkdir()

    def listed(ring):
        rows = "".join(f"{x:.3f};{y:.3f};1.57080\r\n".replace(".", comma).replace(";", ",") for x, y in ring)
        return f"{len(ring)}\r\n{rows}"

    fix = f"{ORIGIN.latitude:.8f};{ORIGIN.longitude:.8f}".replace(".", comma).replace(";", ",")
    (folder / "Field.txt").write_text(
        f"2026\r\n$FieldDir\r\nx\r\n$Offsets\r\n0,0\r\nConvergence\r\n0\r\nStartFix\r\n{fix}\r\n"
    )
    (folder / "Boundary.txt").write_text(f"$Boundary\r\nFalse\r\n{listed(RING)}False\r\nFalse\r\n{listed(HOLE)}")
    (folder / "Headland.txt").write_text(f"$Headland\r\n{listed(0.8 * RING)}")
    return folder


@pytest.mark.parametrize("comma", [".", ","])
def test_agopengps_folder_gives_boundary_and_headland(tmp_path, comma):
    field = read_field(aog(tmp_path / "Hill", comma))
    assert (field.name, field.plane, field.notes) == ("Hill", ORIGIN, ())
    assert field.boundary.area == pytest.approx(AREA)
    assert field.headland.area == pytest.approx(0.64 * 45_400)
    assert [each.area for each in field.obstacles] == [pytest.approx(300)]
    assert read_field(tmp_path / "Hill" / "Boundary.txt").plane == ORIGIN


def test_zip_and_folder_of_task_data_are_read_with_external_files(tmp_path):
    whole = task_data(lsg(2, HOLE))
    start, end = whole.index("<PFD"), whole.index("</ISO")
    place = tmp_path / "TASKDATA"
    place.mkdir()
    (place / "TASKDATA.XML").write_text(whole[:start] + '<XFR A="PFD00001" B="1"/>' + whole[end:])
    (place / "PFD00001.XML").write_text(f"<XFC>{whole[start:end]}</XFC>")
    with zipfile.ZipFile(tmp_path / "task.zip", "w") as archive:
        for file in place.iterdir():
            archive.write(file, f"TASKDATA/{file.name}")
    for path in (place, tmp_path / "task.zip", place / "TASKDATA.XML"):
        assert read_field(path).boundary.area == pytest.approx(AREA, rel=2e-4)


@pytest.mark.parametrize("version", ["v3", "v4"])
def test_task_data_written_by_another_library_is_read(tmp_path, version):
    pytest.importorskip("isoxml")
    from importlib import import_module

    from isoxml.util.isoxml_io import isoxml_to_text

    iso = import_module(f"isoxml.models.base.{version}")
    points = [iso.Point(type=iso.PointType.Other, north=y, east=x) for x, y in degrees(RING)]
    line = iso.LineString(type=iso.LineStringType.PolygonExterior, points=points)
    polygon = iso.Polygon(type=iso.PolygonType.PartfieldBoundary, line_strings=[line])
    part = iso.Partfield(id="PFD1", designator="North", area=1, polygons=[polygon])
    data = iso.Iso11783TaskData(
        management_software_manufacturer="x",
        management_software_version="1",
        data_transfer_origin=iso.Iso11783TaskDataDataTransferOrigin.FMIS,
        partfields=[part],
    )
    assert field_of(tmp_path, "TASKDATA.XML", isoxml_to_text(data)).boundary.area == pytest.approx(45_400, rel=2e-4)


def test_largest_field_is_used_unless_a_name_is_specified(tmp_path):
    far = RING * 0.5 + [1000, 0]
    text = geojson(feature(degrees(far), name="South"), feature(degrees(RING), name="North"))
    field = field_of(tmp_path, "farm.geojson", text)
    assert (field.name, field.notes) == ("North", ("the largest 'North' of 2 fields is used",))
    south = read_field(tmp_path / "farm.geojson", name="south")
    assert south.boundary.area == pytest.approx(45_400 / 4, rel=2e-4)
    with pytest.raises(
        ScenarioError,
        match=r"farm\.geojson: the file has no field 'Sout'; did you mean 'South'\? \(available: South, North",
    ):
        read_field(tmp_path / "farm.geojson", name="Sout")


def metres(ring):
    return "x,y\n" + "\n".join(f"{x:.3f},{y:.3f}" for x, y in ring)


BOW = [(0, 0), (100, 100), (100, 0), (0, 60)]
REPAIRED = {
    "repeated points": (metres(np.repeat(RING, 2, axis=0)), 45_400, "5 repeated points of the boundary omitted"),
    "a point 1 km off": (metres([*RING, (200, 1200)]), 45_400, "point 6 of the boundary is omitted, 1"),
    "a bow": (
        metres(BOW),
        3125,
        "the boundary crosses itself at (37.5, 37.5) m and is repaired, without 1125.00 m2",
    ),
    "a hole outside": (
        geojson(feature(degrees(RING), degrees(HOLE + [500, 0]))),
        45_400,
        "1 hole outside the boundary omitted",
    ),
    "a hole across": (geojson(feature(degrees(RING), degrees(HOLE + [140, 0]))), 45_250, "1 hole cut at the boundary"),
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
def test_damaged_boundary_is_repaired_and_reported(tmp_path, name):
    text, area, note = REPAIRED[name]
    field = field_of(tmp_path, "field.txt", text)
    assert field.boundary.area == pytest.approx(area, rel=1e-3)
    assert field.boundary.is_valid
    assert any(each.startswith(note) for each in field.notes), field.notes


def test_open_line_as_a_boundary_is_reported(tmp_path):
    text = json.dumps({"type": "LineString", "coordinates": degrees(RING)[:-1]})
    field = field_of(tmp_path, "line.json", text)
    assert field.notes == ("the file has no closed ring; the ends of a line are joined to form the boundary",)
    assert field.boundary.area == pytest.approx(45_400, rel=2e-4)
    closed = json.dumps({"type": "LineString", "coordinates": degrees(RING)})
    assert field_of(tmp_path, "closed.json", closed).notes == ()


SCRAPS = (b"nan", b"1e999", b"-1", b"", b"null", b"\xff", b"<", b"{", b",", b"1e300", b"\x00", b"\n")
"""Bytes that replace a part of a file."""


@pytest.mark.parametrize("name", FILES)
def test_mutated_field_file_gives_a_field_or_a_one_line_message(tmp_path, name):
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


HOSTILE = {
    "empty": (b"", "the file is empty; create it again"),
    "binary": (bytes(range(256)) * 20, "the file is not text, or contains null bytes; save it as CSV"),
    "zip": (b"PK\x05\x06" + b"\0" * 18, "the folder contains no field; specify a folder with TASKDATA.XML"),
    "not a number": (b"x,y\n0,0\n9,nan\n9,9\n", "row 3: y is nan; use a finite number"),
    "two points": (b"x,y\n0,0\n9,9\n", "the boundary has 2 points; at least 3 are required"),
    "flat": (b"x,y\n0,0\n50,0\n99,0\n", "the boundary encloses 0 m2, less than 10"),
    "a line of task data": (b'<ISO11783_TaskData VersionMajor="4"/>', "the file contains no boundary; export one"),
    "point without a place": (
        task_data("").replace(' C="', ' Q="').encode(),
        "has a point PNT without the numbers C and D",
    ),
    "unknown text": (b"POLYGON ((0 0, 1", "line 1: the line is not valid WKT"),
    "degrees as metres": (b"58.4,26.7\n58.401,26.7\n58.401,26.701\n", "if the numbers are degrees, name the columns"),
    "half a planet": (
        json.dumps({"type": "Polygon", "coordinates": [[[0, 0], [90, 0], [0, 60]]]}).encode(),
        "extend over",
    ),
    "nested": (b"[" * 200_000, "is not valid JSON"),
    "entities": (b'<!DOCTYPE a [<!ENTITY b "c">]><kml>&d;</kml>', "is damaged XML"),
    "null geometry": (
        b'{"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": null}]}',
        "no boundary",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_malicious_field_file_gives_one_message_with_its_name(tmp_path, name):
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


def test_boundary_with_many_points_is_simplified(tmp_path):
    angle = np.linspace(0, 2 * np.pi, 200_000, endpoint=False)
    field = field_of(tmp_path, "round.csv", metres(np.column_stack([100 * np.cos(angle), 100 * np.sin(angle)])))
    assert field.boundary.area == pytest.approx(np.pi * 1e4, rel=5e-4)
    assert len(field.boundary.exterior.coords) < 1000
    assert field.notes[0].startswith("the boundary is simplified within 0.057 m, from 200000 to ")
