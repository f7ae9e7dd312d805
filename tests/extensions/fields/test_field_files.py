"""Fields from every file format: equal polygons, and the names, obstacles and headlands in the files."""

import json
import zipfile
from warnings import catch_warnings

import pytest

shapely = pytest.importorskip("shapely")

from field_texts import (  # noqa: E402
    AREA,
    FILES,
    GML3,
    HOLE,
    ORIGIN,
    RING,
    aog,
    degrees,
    feature,
    field_of,
    geojson,
    lsg,
    task_data,
)

from agrobot_mj.core.errors import ScenarioError  # noqa: E402
from agrobot_mj.extensions.fields.reading import read_field  # noqa: E402


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


def test_obstacle_given_as_a_single_point_is_reported(tmp_path):
    text = json.loads(FILES["obstacle.geojson"])
    text["features"].append(
        {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [6, 52]}}
    )
    assert any(
        "single points (1) are omitted" in note for note in field_of(tmp_path, "a.geojson", json.dumps(text)).notes
    )
    assert not field_of(tmp_path, "b.geojson", FILES["obstacle.geojson"]).notes


def test_field_file_with_projected_coordinates_gives_the_same_field(tmp_path):
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


@pytest.mark.parametrize("name", ["a.kml", "v4.xml", "TASKDATA.XML"])
@pytest.mark.parametrize("codec", ["utf-8", "latin-1", "cp1252", "utf-16"])
def test_xml_field_in_any_declared_encoding_keeps_its_name(tmp_path, name, codec):
    text = FILES[name.replace("TASKDATA.XML", "v4.xml")].replace('<?xml version="1.0"?>', "")
    text = text.replace("North", "Grönfält").replace("<Placemark>", "<Placemark><name>Grönfält</name>")
    (tmp_path / name).write_bytes(f'<?xml version="1.0" encoding="{codec}"?>{text}'.encode(codec))
    field = read_field(tmp_path / name)
    assert field.name == "Grönfält"
    assert field.boundary.area == pytest.approx(AREA, rel=2e-4)


@pytest.mark.parametrize("change", ["", "no shx", "other shx", "upper case", "no dbf"])
def test_shapefile_with_missing_or_renamed_parts_is_read(tmp_path, change):
    pyproj, shapefile = pytest.importorskip("pyproj"), pytest.importorskip("shapefile")
    for name, rings in {"farm": (RING[::-1], HOLE), "other": (RING,)}.items():
        with shapefile.Writer(str(tmp_path / name), shapeType=shapefile.POLYLINE, encoding="cp1252") as writer:
            writer.field("NAME", "C")
            for ring in rings:
                writer.line([degrees(ring)])
                writer.record("Grönfält")
    (tmp_path / "farm.prj").write_text(pyproj.CRS("EPSG:4326").to_wkt("WKT1_ESRI"))
    if change.startswith("no "):
        (tmp_path / f"farm.{change[3:]}").unlink()
    elif change == "other shx":
        (tmp_path / "other.shx").replace(tmp_path / "farm.shx")
    elif change:
        for file in list(tmp_path.glob("farm.*")):
            file.rename(file.with_suffix(file.suffix.upper()))
    field = read_field(next(file for file in tmp_path.glob("farm.*") if file.suffix.lower() == ".shp"))
    assert field.name == ("farm" if change == "no dbf" else "Grönfält")
    assert field.boundary.area == pytest.approx(AREA, rel=2e-4)


def test_error_for_a_shapefile_of_surfaces_names_their_type(tmp_path):
    shapefile = pytest.importorskip("shapefile")
    with shapefile.Writer(str(tmp_path / "farm.shp"), shapeType=shapefile.MULTIPATCH) as writer:
        writer.field("NAME", "C")
        writer.multipatch([[[*point, 0.0] for point in RING]], partTypes=[shapefile.OUTER_RING])
        writer.record("roof")
    with pytest.raises(ScenarioError, match=r"contains 3D surfaces \(MULTIPATCH\); export polygons or lines"):
        read_field(tmp_path / "farm.shp")


def test_csv_title_row_that_starts_with_point_is_not_read_as_wkt(tmp_path):
    rows = "\n".join(f"{k},{x},{y}" for k, (x, y) in enumerate(RING))
    field = field_of(tmp_path, "survey.csv", f"point,easting_m,northing_m\n{rows}\n")
    assert field.boundary.area == pytest.approx(shapely.Polygon(RING).area)
    assert field.notes == ("column point is ignored",)


def test_metres_from_a_local_origin_are_rejected_in_a_national_grid(tmp_path):
    pytest.importorskip("pyproj")
    file = tmp_path / "local.csv"
    file.write_text("x,y\n0,0\n60,0\n60,50\n0,50\n")
    with pytest.raises(ScenarioError, match="coordinates outside the area of EPSG:25832; correct"):
        read_field(file, crs="EPSG:25832")


def test_grid_coordinates_in_the_wrong_order_are_swapped(tmp_path):
    pytest.importorskip("pyproj")
    file = tmp_path / "swapped.csv"
    file.write_text("x,y\n5795000,400000\n5795000,400120\n5795090,400120\n5795090,400000\n")
    swapped = read_field(file, crs="EPSG:32632")
    assert swapped.notes == ("east and north are swapped, because only the other order is in the area of EPSG:32632",)
    file.write_text("x,y\n400000,5795000\n400120,5795000\n400120,5795090\n400000,5795090\n")
    field = read_field(file, crs="EPSG:32632")
    assert (field.notes, field.boundary.area) == ((), pytest.approx(120 * 90, rel=1e-3))
    assert swapped.plane == pytest.approx(field.plane)
    assert swapped.boundary.symmetric_difference(field.boundary).area < 0.1
    file.write_text("x,y\n5795000,5795000\n5795000,5795120\n5795090,5795120\n")
    with pytest.raises(ScenarioError, match="outside the area of EPSG:32632; correct the coordinate system, or the or"):
        read_field(file, crs="EPSG:32632")
    file.write_text("x,y\n2000000,4000000\n2000120,4000000\n2000120,4000090\n2000000,4000090\n")
    assert read_field(file, crs="EPSG:3460").plane.longitude == pytest.approx(178.75, abs=0.01)  # Fiji


@pytest.mark.parametrize("comma", [".", ","])
def test_agopengps_folder_gives_boundary_and_headland(tmp_path, comma):
    field = read_field(aog(tmp_path / "Hill", comma))
    assert (field.name, field.plane, field.notes) == ("Hill", ORIGIN, ())
    assert field.boundary.area == pytest.approx(AREA)
    assert field.headland.area == pytest.approx(0.64 * 45_400)
    assert [each.area for each in field.obstacles] == [pytest.approx(300)]
    assert read_field(tmp_path / "Hill" / "Boundary.txt").plane == ORIGIN


def test_zip_archive_of_an_agopengps_folder_names_the_field(tmp_path):
    folder = aog(tmp_path / "Hill")
    with zipfile.ZipFile(tmp_path / "valley.zip", "w") as archive:
        for file in folder.iterdir():
            archive.write(file, file.name)
    assert read_field(tmp_path / "valley.zip").name == "valley"


@pytest.mark.parametrize("again", ["a.geojson", "../a.geojson", "/a.geojson"])
def test_zip_archive_with_two_files_of_the_same_name_is_rejected(tmp_path, again):
    with zipfile.ZipFile(tmp_path / "farm.zip", "w") as archive, catch_warnings(action="ignore"):
        for name in ("a.geojson", again):
            archive.writestr(name, FILES["a.geojson"])
    with pytest.raises(ScenarioError, match=f"farm.zip: the archive contains '{again}' twice; create the archive"):
        read_field(tmp_path / "farm.zip")


def test_first_of_several_fields_in_a_folder_is_read_and_reported(tmp_path):
    place = tmp_path / "farm"
    place.mkdir()
    for name in ("b.kml", "a.kml"):
        (place / name).write_text(FILES["a.kml"])
    (place / "notes.csv").write_text("x,y\n")
    field = read_field(place)
    assert field.name == "a"
    assert field.notes == ("only 'a.kml' is read, the first of 2 sources; specify the path of one",)
    for name in ("East", "West"):
        aog(tmp_path / name)
    field = read_field(tmp_path)
    assert field.name == "East"
    assert field.notes == ("only 'East' is read, the first of 4 sources; specify the path of one",)


def test_isoxml_zip_and_folder_are_read_with_external_files(tmp_path):
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
def test_isoxml_task_data_written_by_another_library_is_read(tmp_path, version):
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


def test_largest_field_of_a_file_is_used_unless_a_name_is_specified(tmp_path):
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


@pytest.mark.parametrize("name", ["fiboa.json", "taskdata.xml"])
@pytest.mark.parametrize("hectares", [4.54, 4.5])
def test_swapped_degrees_are_found_by_the_area_in_the_file(tmp_path, name, hectares):
    swapped = [place[::-1] for place in degrees(RING)]
    content = geojson(feature(swapped, area=hectares), fiboa_version="0.3.0")
    if name == "taskdata.xml":
        ring = "".join(f'<PNT A="2" C="{y:.9f}" D="{x:.9f}"/>' for x, y in swapped)
        content = f'<ISO11783_TaskData><PFD A="PFD1" C="North" D="{1e4 * hectares:.0f}"><PLN A="1"><LSG A="1">{ring}'
        content += "</LSG></PLN></PFD></ISO11783_TaskData>"
    field = field_of(tmp_path, name, content)
    assert field.plane == pytest.approx(ORIGIN, abs=1e-6)
    assert field.boundary.area == pytest.approx(45_400.0, rel=1e-3)
    said = f"the area of {hectares:.4g} ha in the file fits only the other order"
    assert field.notes == (f"latitude and longitude are swapped, because {said}",)


def test_degree_order_is_kept_if_the_stated_area_fits_both_orders(tmp_path):
    ring = [[44.0 + x * 1.27e-5, 45.0 + y * 0.9e-5] for x, y in (*RING, RING[0])]
    field = field_of(tmp_path, "a.json", geojson(feature(ring, area=4.54)))
    assert (round(field.plane.latitude), round(field.plane.longitude), field.notes) == (45, 44, ())


@pytest.mark.parametrize("swaps", [False, True])
def test_area_in_square_metres_is_recognised_in_both_orders_of_degrees(tmp_path, swaps):
    ring = [place[:: -1 if swaps else 1] for place in degrees(RING)]
    field = field_of(tmp_path, "fiboa.json", geojson(feature(ring, area=45_400.0), fiboa_version="0.3.0"))
    assert field.plane == pytest.approx(ORIGIN, abs=1e-6)
    said = "latitude and longitude are swapped, because the area of 45400 m2 in the file fits only the other order"
    unit = "the area of 45400 in the file is read in m2, because it is too large in ha"
    assert field.notes == (unit, said)[: 1 + swaps]


@pytest.mark.parametrize("area", [4.54, 11.22, 454, 0, -1, "4.54", None, float("nan")])
def test_valid_degree_order_is_kept_for_any_area_stated_in_the_file(tmp_path, area):
    field = field_of(tmp_path, "a.json", geojson(feature(degrees(RING), area=area)))
    assert field.plane == pytest.approx(ORIGIN, abs=1e-6)
    assert field.notes == ()
