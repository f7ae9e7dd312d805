"""The importer of positions: the same track from every format, and messages for damaged files."""

import json
import re

import numpy as np
import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.core.resources import stamp
from agrobot_mj.paths import Waypoints
from agrobot_mj.paths.imports import clean, local_shapes, read_shapes
from agrobot_mj.paths.imports.agopengps import comma_numbers, read_origin
from agrobot_mj.paths.imports.cleaning import outliers
from agrobot_mj.paths.waypoints import track
from agrobot_mj.scenario.hints import hints

ORIGIN = Origin(52.31, 6.72)
BEND = np.array([(-40.0, -10.0), (0.0, -10.0), (30.0, 0.0), (40.0, 30.0)])
"""Track [m], whose bounding box has its middle at (0, 10)."""
DEGREES = np.array([to_geodetic(ORIGIN, *point)[::-1] for point in BEND])  # Longitude and latitude of the track [deg]
PAIRS = [f"{lon:.9f},{lat:.9f}" for lon, lat in DEGREES]


def kml(inner):
    return f'<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>{inner}</Document></kml>'


def placemark(geometry, name="row"):
    return f"<Placemark><name>{name}</name>{geometry}</Placemark>"


def line_of(tag, pairs):
    return f"<{tag}><coordinates>{' '.join(f'{pair},12.5' for pair in pairs)}</coordinates></{tag}>"


GPX_POINTS = "".join('<trkpt lon="{}" lat="{}"><ele>3</ele></trkpt>'.format(*pair.split(",")) for pair in PAIRS)
FORMATS = {
    "lat_lon.csv": "lat,lon,heading\n" + "".join(f"{lat:.9f},{lon:.9f},45\n" for lon, lat in DEGREES),
    "lon_lat.csv": "Longitude [deg];Latitude [deg]\n" + "\n".join(pair.replace(",", ";") for pair in PAIRS),
    "german.csv": "lon\tlat\n" + "\n".join(pair.replace(",", "\t").replace(".", ",") for pair in PAIRS),
    "line.kml": kml(placemark(line_of("LineString", PAIRS))),
    "line.gpx": f'<gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>{GPX_POINTS}</trkseg></trk></gpx>',
    "line.geojson": json.dumps({"type": "LineString", "coordinates": DEGREES.tolist()}),
    "feature.geojson": json.dumps(
        {
            "type": "FeatureCollection",
            "features": [
                {"type": "Feature", "properties": None, "geometry": {"type": "Point", "coordinates": [6.7, 52.3, 4]}},
                {"type": "Feature", "geometry": {"type": "LineString", "coordinates": DEGREES.tolist()}},
            ],
        }
    ),
    "xy.csv": "x,y,theta\n" + "".join(f"{x},{y - 10},0.5\n" for x, y in BEND),
    "yx.csv": "north,east\n" + "".join(f"{y - 10},{x}\n" for x, y in BEND),
    "comment.csv": "# made by hand\n# s_m; x_m; y_m\n" + "".join(f"{x + y};{x};{y - 10}\n" for x, y in BEND),
    "spaces.txt": "% time x y yaw\n" + "".join(f"7.5  {x} {y - 10}  0.4\n" for x, y in BEND),
    "ros.csv": "%time,field.pose.pose.position.x,field.pose.pose.position.y,field.pose.pose.orientation.x\n"
    + "".join(f"9,{x},{y - 10},0.4\n" for x, y in BEND),
    "two_titles.csv": "Column1;Column2\nX-axis;Y-axis\n" + "".join(f"{x};{y - 10}\n" for x, y in BEND),
    "camel_case.csv": "Link,PositionX (m),PositionY (m)\n" + "".join(f"A1,{x},{y - 10}\n" for x, y in BEND),
    "end_commas.csv": "place,lat,lon\n" + "".join(f"home,{lat:.9f},{lon:.9f},\n" for lon, lat in DEGREES),
    "web_map.geojson": "var row = " + json.dumps({"type": "LineString", "coordinates": DEGREES.tolist()}) + ";\n",
    "RecPath.txt": "$RecPath\n4\n" + "".join(f"{x:.3f},{y - 10:.3f},0.5,7.2,False\n" for x, y in BEND),
    "decimal_commas.txt": "$RecPath\r\n4\r\n"
    + "".join(f"{x:.3f};{y - 10:.3f};0.5;7.2\r\n".replace(".", ",").replace(";", ",") for x, y in BEND),
}


def points_of(folder, name, content, crs=""):
    """Return the waypoints of a file."""
    (folder / name).write_text(content, encoding="utf-8")
    return track(stamp(str(folder / name)), crs, False)


@pytest.mark.parametrize("name", FORMATS)
def test_every_path_file_format_gives_the_same_track(tmp_path, name):
    points, _ = points_of(tmp_path, name, FORMATS[name])
    np.testing.assert_allclose(points[:, :2], BEND - [0, 10], atol=0.02)


def test_recorded_speed_is_converted_to_metres_per_second(tmp_path):
    for name in ("RecPath.txt", "decimal_commas.txt"):
        assert points_of(tmp_path, name, FORMATS[name]).points[:, 2] == pytest.approx(2.0)
    text = "x,y,speed [km/h]\n" + "".join(f"{x},{y},9\n" for x, y in BEND)
    assert points_of(tmp_path, "fast.csv", text).points[:, 2] == pytest.approx(2.5)


@pytest.mark.parametrize("name", ["theta", "yaw_rad", "heading", "z"])
def test_column_of_another_quantity_is_not_read_as_speed(tmp_path, name):
    points, notes = points_of(tmp_path, "poses.csv", f"x,y,{name}\n" + "".join(f"{x},{y},0.4\n" for x, y in BEND))
    assert points.shape[1] == 2
    assert notes == (f"column {name} is ignored",)


CIRCLE = 20 * np.array([(np.cos(a), np.sin(a)) for a in np.linspace(0, 5, 40)])
"""Arc in counter-clockwise direction [m]; its heading is the angle plus a quarter turn."""
THIRD = {
    "heading": np.linspace(0, 5, 40) + np.pi / 2,
    "compass": -np.linspace(0, 5, 40) % (2 * np.pi),
    "height": np.linspace(-30, -31, 40),
    "degrees": np.degrees(np.linspace(0, 5, 40)),
}


@pytest.mark.parametrize("name", THIRD)
def test_unnamed_third_column_of_headings_or_heights_is_not_read(tmp_path, name):
    text = "".join(f"{x},{y},{z}\n" for (x, y), z in zip(CIRCLE, THIRD[name], strict=True))
    points, notes = points_of(tmp_path, "unnamed.csv", text)
    np.testing.assert_allclose(points, CIRCLE)
    assert notes == ("the third column does not contain speeds and is ignored",)


def test_unnamed_third_column_with_speeds_is_read_as_speed(tmp_path):
    text = "".join(f"{x},{y},{2 + 0.01 * k}\n" for k, (x, y) in enumerate(CIRCLE))
    assert points_of(tmp_path, "unnamed.csv", text).points[:, 2] == pytest.approx(2 + 0.01 * np.arange(40))


def test_recorded_speeds_are_limited_and_missing_ones_filled(tmp_path):
    speeds = ["0", "0", "1", "", "", "4", *["8"] * 34]
    text = "x,y,speed\n" + "".join(f"{x},{y},{v}\n" for (x, y), v in zip(CIRCLE, speeds, strict=True))
    points, notes = points_of(tmp_path, "drive.csv", text)
    assert points[:, 2].tolist() == pytest.approx([0.1, 0.1, 1, 2, 3, 4, *[5] * 34])
    assert notes == (
        "missing speeds in 2 rows are interpolated",
        "34 speeds above 5 m/s are limited to 5 m/s",
        "2 speeds at a standstill are raised to 0.1 m/s",
    )
    empty = "x,y,speed\n" + "".join(f"{x},{y},\n" for x, y in CIRCLE)
    assert points_of(tmp_path, "empty.csv", empty).points.shape == (40, 2)


def test_rows_of_a_path_file_without_a_position_are_omitted(tmp_path):
    text = "t,x,y\n0,,\n" + "".join(f"{k},{x},{y}\n" for k, (x, y) in enumerate(BEND)) + "9,,\n"
    points, notes = points_of(tmp_path, "gaps.csv", text)
    np.testing.assert_allclose(points, BEND)
    assert notes == ("column t is ignored", "2 rows without a position are omitted")
    with pytest.raises(ValueError, match="row 2: y is not a number: ''"):
        points_of(tmp_path, "half.csv", "x,y\n1,\n2,3\n")


def test_path_table_in_a_windows_encoding_is_read(tmp_path):
    (tmp_path / "acker.csv").write_bytes("x,y,Flächenname\n".encode("cp1252") + b"0,0,\xfc\n10,0,\xe4\n20,5,a\n")
    assert track(stamp(str(tmp_path / "acker.csv")), "", False).points.tolist() == [[0, 0], [10, 0], [20, 5]]


@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:32631", "EPSG:28992"])
def test_projected_and_geographic_coordinates_give_the_same_track(tmp_path, crs):
    pyproj = pytest.importorskip("pyproj")
    grid = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(*DEGREES.T)
    text = "easting,northing\n" + "".join(f"{x:.4f},{y:.4f}\n" for x, y in np.transpose(grid))
    points, notes = points_of(tmp_path, "grid.csv", text, crs)
    legs = np.hypot(*np.diff(points, axis=0).T)
    np.testing.assert_allclose(legs, np.hypot(*np.diff(BEND, axis=0).T), atol=0.02)
    np.testing.assert_allclose(points, BEND - [0, 10], atol=1.0)  # systems of Europe differ by the drift of continents
    assert notes == ()


def test_shapefile_with_projected_coordinates_gives_the_same_track(tmp_path):
    pyproj, shapefile = pytest.importorskip("pyproj"), pytest.importorskip("shapefile")
    grid = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True).transform(*DEGREES.T)
    with shapefile.Writer(str(tmp_path / "rows.shp"), encoding="latin-1") as writer:
        writer.field("name", "C")
        writer.line([np.transpose(grid).tolist()])
        writer.record("Fläche 1")
    (tmp_path / "rows.prj").write_text(pyproj.CRS("EPSG:25832").to_wkt("WKT1_ESRI"))
    points = track(stamp(str(tmp_path / "rows.shp")), "", False).points
    np.testing.assert_allclose(points, BEND - [0, 10], atol=1.0)
    (tmp_path / "rows.shp").write_bytes((tmp_path / "rows.shp").read_bytes()[:120])
    with pytest.raises(ValueError, match=r"rows\.shp: the shapefile is damaged"):
        read_shapes(str(tmp_path / "rows.shp"))


def test_coordinates_far_from_the_origin_are_shifted_to_the_origin(tmp_path):
    text = "x,y\n" + "".join(f"{x + 432100.25},{y + 5791000.5}\n" for x, y in BEND)
    points, notes = points_of(tmp_path, "far.csv", text)
    np.testing.assert_allclose(points, BEND + [0.25, -9.5])
    assert notes == ("(432100, 5791010) m is subtracted from all coordinates",)
    near = points_of(tmp_path, "near.csv", "x,y\n" + "".join(f"{x + 1500},{y}\n" for x, y in BEND))
    np.testing.assert_allclose(near.points, BEND + [1500, 0])


def test_track_across_the_antimeridian_is_continuous(tmp_path):
    text = "lat,lon\n-17.0,179.9998\n-17.0,-179.9999\n-16.9999,-179.9995\n"
    points, _ = points_of(tmp_path, "fiji.csv", text)
    assert np.hypot(*np.diff(points, axis=0).T) == pytest.approx([31.9, 44.0], abs=0.2)
    assert -180 <= local_shapes(read_shapes(str(tmp_path / "fiji.csv"))).origin.longitude <= 180


def test_longest_line_of_a_file_is_used_as_the_track(tmp_path):
    marks = placemark(line_of("LineString", PAIRS[:2]), "short") + placemark(line_of("LineString", PAIRS), "long")
    points, notes = points_of(tmp_path, "two.kml", kml(marks))
    assert len(points) == 4
    assert notes == ("the longest, 'long', of 2 lines is used",)


def recorded(noise=0.015, stop=40):
    """Return a track of 60 m recorded at 5 Hz with noise, a repeated point, and a stop in the middle [m]."""
    s = np.sort(np.concatenate([np.arange(0, 60, 0.2), np.full(stop, 30.0)]))
    way = np.column_stack([s, 4 * np.sin(s / 12)]) + np.random.default_rng(5).normal(0, noise, (len(s), 2))
    way[70] = way[69]
    return way


def test_recorded_track_with_a_stop_is_converted_to_a_drivable_path(tmp_path):
    way = recorded()
    (tmp_path / "way.csv").write_text("x,y\n" + "".join(f"{x:.3f},{y:.3f}\n" for x, y in way))
    path = Waypoints(file=str(tmp_path / "way.csv"))
    assert path.max_curvature < 1 / (0.4 * path.corner_radius_m)
    found = np.array([path.at(t)[:2] for t in np.linspace(0, path.duration_s, 400).tolist()])
    assert np.abs(found[:, 1] - 4 * np.sin(found[:, 0] / 12)).max() < 0.1
    assert all(word in note for word, note in zip(("omitted", "reduced", "smoothed"), path.notes, strict=True))
    (tmp_path / "mine.toml").write_text('[path]\nkind = "waypoints"\nfile = "way.csv"\n')
    said = [line for line in hints(load_scenario(tmp_path / "mine.toml")) if line.startswith("path.file: ")]
    assert said[0] == "path.file: 1 repeated point is omitted"


def test_recorded_track_without_noise_is_not_changed():
    kept, notes = clean(BEND)
    assert kept.tolist() == [0, 1, 2, 3]
    assert notes == []


def test_long_reverse_section_of_a_track_is_kept():
    out_and_back = np.array([(0, 0), (20, 0), (40, 0), (10, 0.5), (0, 1)], dtype=float)
    assert clean(out_and_back) == (pytest.approx(np.arange(5)), [])


def test_error_for_segments_too_short_for_a_corner_has_no_solver_text(tmp_path):
    tight = [(0, 0), (10, 0), (10, 0.002), (0, 0.3)]
    (tmp_path / "tight.csv").write_text("".join(f"{x},{y}\n" for x, y in tight))
    with pytest.raises(ValueError, match="too short for its corner of 90 deg") as error:
        Waypoints(file=str(tmp_path / "tight.csv")).check()
    assert "signs" not in str(error.value)


def test_single_distant_point_of_a_track_is_classified_as_an_outlier():
    ring = np.array([(0, 0), (100, 0), (100, 50), (0, 50), (20, 1130)], dtype=float)
    assert outliers(ring).tolist() == [4]
    assert outliers(ring[:4]).tolist() == []
    assert outliers(np.column_stack([np.arange(0.0, 200), np.zeros(200)])).tolist() == []


DAMAGED = {
    "a.kml": (kml(placemark("<LineString><coordinates>6.7;52.3</coordinates></LineString>")), "not longitude,latitude"),
    "b.kml": (kml("")[:-8], "is not valid XML"),
    "c.kml": (kml(""), "the file contains no positions; export the file again"),
    "d.json": ('{"type": "FeatureCollection"', "is not valid JSON"),
    "e.json": ('{"a": 1}', "is JSON, but not GeoJSON"),
    "f.json": ('{"type": "LineString", "coordinates": [[1, "x"]]}', "not a pair of numbers"),
    "g.json": ('{"type": "LineString", "coordinates": 7}', "a geometry without coordinates"),
    "h.json": ("[" * 100_000, "is not valid JSON"),
    "i.json": ('{"type": "Curve", "coordinates": []}', "has a geometry of type 'Curve'; use Polygon"),
    "j.txt": ("$RecPath\n9\n1,2,3,4\n", "the file declares 9 points, but contains fewer"),
    "k.txt": ("$Boundary\nTrue\nmany\n", "line 3: 'many' is not a number of points"),
    "l.xml": ("<gml/>", "is XML of an unknown type; convert it to one of KML, GPX, GeoJSON"),
    "m.csv": ("lat,lon\n0,0\n1,1\n2,2\n", "extend over 222.6 km, more than 100 km; remove distant points"),
    "n.json": ('{"type": "LineString", "coordinates": [[6.7, 452], [6.8, 452]]}', "not latitudes and longitudes"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_error_for_a_damaged_path_file_names_the_file(tmp_path, name):
    content, text = DAMAGED[name]
    with pytest.raises(ValueError, match=name) as error:
        points_of(tmp_path, name, content)
    assert str(error.value).startswith(f"{name}: ")
    assert text in str(error.value)
    assert "\n" not in str(error.value)


def test_unknown_coordinate_system_is_reported(tmp_path):
    pytest.importorskip("pyproj")
    with pytest.raises(ValueError, match="crs: 'EPSG:1' is an unknown coordinate system; use a code like EPSG:25832"):
        points_of(tmp_path, "a.csv", "x,y\n0,0\n1,1\n2,2\n", "EPSG:1")


def test_decimal_commas_are_distinguished_from_separators():
    assert comma_numbers("40,71280000,-74,00600000", 2) == [40.7128, -74.006]
    assert comma_numbers("40.7128,-74.006", 2) == [40.7128, -74.006]
    assert comma_numbers("12,34,1", 2) == [12, 34]
    assert read_origin("$Offsets\r\n0,0\r\nStartFix\r\n-0,5,10,25\r\n") == Origin(-0.5, 10.25)
    assert read_origin("Convergence\r\n0\r\n") is None


@pytest.mark.parametrize("more", ["", ",1.5"])
@pytest.mark.parametrize("first", ["", "0.000000,0.000000{}\n"])
def test_untitled_latitudes_and_longitudes_are_recognised(tmp_path, first, more):
    rows = "".join(f"{lat:.7f},{lon:.7f}{more}\n" for lon, lat in DEGREES)
    (tmp_path / "log.csv").write_text(first.format(more) + rows)
    shapes = read_shapes(str(tmp_path / "log.csv"))
    assert shapes.crs == "EPSG:4326"
    assert shapes.shapes[0].points[-len(DEGREES) :] == pytest.approx(DEGREES, abs=1e-7)
    assert "the first two columns are read as latitude and longitude" in shapes.notes[-1]


@pytest.mark.parametrize(
    "rows",
    [
        [(x, y - 10) for x, y in BEND],
        [(52.0 + x / 100, 6.0 + y / 100) for x, y in BEND],
        [(0.123456, 0.0), (0.134567, 0.0123457), (0.145678, 0.0234567)],
        [(52.3, 6.7), (52.31, 6.71), (52.32, 6.7)],
        [(520123.123456, 6.712345), (520123.223456, 6.812345), (520123.212345, 6.712355)],
    ],
    ids=["plane", "extent of 0.8 m", "near the origin", "few digits", "map grid"],
)
def test_untitled_metres_are_not_read_as_degrees(tmp_path, rows):
    (tmp_path / "log.csv").write_text("".join(f"{float(x)!r},{float(y)!r}\n" for x, y in rows))
    shapes = read_shapes(str(tmp_path / "log.csv"))
    assert shapes.crs == ""
    assert shapes.shapes[0].points == pytest.approx(np.array(rows))


def track_with_reverse(back, step=0.25, turn=0.0):
    """Return a track of 20 m to the east that reverses at x = 10 by `back` [m] and then continues at an angle `turn`
    [rad]."""
    there, reverse, on = np.arange(0, 10, step), np.arange(10, 10 - back, -step), np.arange(0, 10 + back, step)
    x = np.concatenate([there, reverse, 10 - back + on * np.cos(turn)])
    y = np.concatenate([0 * there, 0 * reverse, on * np.sin(turn)])
    return np.column_stack([x, y + 0.01 * np.sin(40 * x)])


@pytest.mark.parametrize("step", [0.1, 0.25, 1.5])
@pytest.mark.parametrize("back", [1.6, 2.0, 2.9])
def test_fold_back_is_omitted_with_one_sentence(back, step):
    track = track_with_reverse(back, step)
    kept, notes = clean(track)
    x, y = track[kept].T
    assert (np.diff(x) > 0).all()
    assert x[-1] == track[-1, 0]
    assert (x.size < len(track), np.diff(x).max()) == (True, pytest.approx(step, abs=step))
    assert notes[-1].endswith(" omitted at a fold-back of at most 3 m")
    assert len([note for note in notes if "repeated" not in note]) == 1


@pytest.mark.parametrize(("back", "turn"), [(4.0, 0.0), (8.0, 0.0), (2.9, 1.5), (2.9, -2.0)])
def test_longer_reversing_and_reversing_into_a_new_direction_are_kept(tmp_path, back, turn):
    track = track_with_reverse(back, turn=turn)
    assert not any("fold" in note for note in clean(track)[1])
    rows = "\n".join(f"{x:.3f},{y:.3f}" for x, y in track)
    (tmp_path / "track.csv").write_text(f"x,y\n{rows}\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"the recorded track reverses at \(10\.0, -?0\.0\) m, but waypoints"):
        Waypoints(file=str(tmp_path / "track.csv")).check()


@pytest.mark.parametrize("column", ["direction", "speed"])
def test_reverse_driving_marked_in_a_track_file_is_rejected(tmp_path, column):
    track = track_with_reverse(2.0)
    values = np.where(np.append(np.diff(track[:, 0]), 1.0) < 0, -1.0, 1.0)
    rows = "\n".join(f"{x:.3f},{y:.3f},{value:g}" for (x, y), value in zip(track, values, strict=True))
    (tmp_path / "track.csv").write_text(f"x,y,{column}\n{rows}\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"track reverses at|speed is -1 m/s"):
        Waypoints(file=str(tmp_path / "track.csv")).check()


def spaced(parts, step):
    """Return the points of polylines at distances of `step` [m]."""
    found = []
    for line in parts:
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
        at = np.linspace(0.0, along[-1], max(round(along[-1] / step), 1) + 1)
        found.append(np.column_stack([np.interp(at, along, axis) for axis in line.T]))
    return found


def arc(centre, radius, first, last):
    angles = np.radians(np.linspace(first, last, 90))
    return np.asarray(centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)])


def k_turn(back, step):
    """Return a track that turns left from a pass of 40 m, reverses by `back` [m] from (45, 5) m, and turns left into
    the next pass."""
    ahead = np.vstack([[(0, 0)], arc((40, 5), 5, -90, 0)])
    on = np.vstack([arc((40, 5 - back), 5, 0, 90), [(0, 10 - back)]])
    return spaced([ahead, np.array([(45, 5), (45, 5 - back)]), on], step)


def two_passes(step):
    """Return a track of two passes of 40 m with a half turn of the radius 6 m."""
    return spaced([np.vstack([[(0, 0)], arc((40, 6), 6, -90, 90), [(0, 12)]])], step)


def waypoints_of(folder, points):
    """Return the path along a file with `points`."""
    np.savetxt(folder / "track.csv", points, "%.4f", ",", header="x,y", comments="")
    return Waypoints(file=str(folder / "track.csv"))


def with_noise(parts, noise, stop, correlation=0.0):
    """Return the points of a track with position noise [m], and `stop` more points at the end of each part."""
    points = np.vstack([np.vstack([part, np.repeat(part[-1:], stop, axis=0)]) for part in parts])
    errors = np.random.default_rng(7).normal(0.0, noise, points.shape)
    for k in range(1, len(errors)):
        errors[k] = correlation * errors[k - 1] + np.sqrt(1 - correlation**2) * errors[k]
    return points + errors


@pytest.mark.parametrize("stop", [0, 30])
@pytest.mark.parametrize("step", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("back", [4.0, 6.0, 8.0])
def test_recorded_k_turn_is_rejected_with_the_position_of_the_cusp(tmp_path, back, step, stop):
    points = with_noise(k_turn(back, step), 0.02, stop)
    with pytest.raises(ValueError, match=r"reverses at \((44\.9|45\.0|45\.1), (4\.9|5\.0|5\.1)\) m"):
        waypoints_of(tmp_path, points).check()


def test_smoothed_track_states_its_maximum_distance_from_the_points(tmp_path):
    (track,) = spaced([np.array([(0, 0), (40, 0), (40, 40)])], 0.25)
    path = waypoints_of(tmp_path, track)
    (distance,) = re.findall(r"\(rms\) and ([\d.]+) m \(maximum, at .* with a radius below 1\.6 m$", path.notes[-1])
    points = np.array([path.at(t)[:2] for t in np.linspace(0, path.duration_s, 3000).tolist()])
    away = max(np.hypot(*(points - point).T).min() for point in track)
    assert float(distance) == pytest.approx(away, rel=0.02)
    assert 0.05 < away < 1.0


def test_fold_back_above_3_m_at_wide_spacing_is_rejected(tmp_path):
    with pytest.raises(ValueError, match=r"reverses at \(10\.0, -?0\.0\) m"):
        waypoints_of(tmp_path, track_with_reverse(3.5, 0.5)).check()


@pytest.mark.parametrize("stop", [0, 60])
@pytest.mark.parametrize(
    ("step", "noise", "correlation"),
    [(0.1, 0.02, 0.0), (0.5, 0.02, 0.0), (2.0, 0.02, 0.0), (0.1, 0.5, 0.0), (0.5, 0.5, 0.0)]
    + [(0.1, 0.5, 0.998), (0.1, 1.0, 0.998), (0.1, 2.0, 0.9998), (0.5, 0.5, 0.99)],
)
def test_position_noise_is_not_read_as_reverse_driving(tmp_path, step, noise, correlation, stop):
    track = with_noise(two_passes(step), noise, stop, correlation)
    path = waypoints_of(tmp_path, track)
    points = np.array([path.at(t)[:2] for t in np.linspace(0, path.duration_s, 400).tolist()])
    away = [np.hypot(*(track - point).T).min() for point in points]
    assert max(away) < max(step, 4 * noise)


@pytest.mark.parametrize("radius", [2.0, 2.5, 3.0, 6.0])
@pytest.mark.parametrize("step", [1.5, 2.5, 2.9])
def test_tight_bends_of_a_sparse_track_are_not_reverse_driving(tmp_path, radius, step):
    """On a figure-eight with few points per bend, the third differences overestimate the position noise."""
    loops = [arc((0, radius), radius, -90, 270), arc((0, -radius), radius, 90, -270)]
    for start in range(0, 90, 15):
        (track,) = spaced([np.vstack([loops[0][start:], loops[1][1:], loops[0][1:], loops[1][1:]])], step)
        path = waypoints_of(tmp_path, with_noise([track], 0.05, 0))
        points = np.array([path.at(t)[:2] for t in np.linspace(0, path.duration_s, 400).tolist()])
        assert max(np.hypot(*(points - point).T).min() for point in track) < 1.0


def test_sharp_recorded_track_keeps_its_shape(tmp_path):
    corners = np.array([(12 * (k // 2 % 2), 1.5 * ((k + 1) // 2)) for k in range(12)], dtype=float)
    track = np.vstack([each[:-1] for each in spaced([corners[k : k + 2] for k in range(11)], 0.25)])
    path = waypoints_of(tmp_path, track)
    points = np.array([path.at(t)[:2] for t in np.linspace(0, path.duration_s, 3000).tolist()])
    assert max(np.hypot(*(points - point).T).min() for point in track) < 0.1


def test_short_track_that_turns_back_in_its_middle_is_unchanged():
    track = np.array([(0.0, 0.0), (0.0, 1.3), (0.0, 2.6), (0.2, 1.4), (0.4, 0.1)])
    kept, notes = clean(track)
    assert (len(kept), notes) == (5, [])


def test_waypoints_path_along_a_track_with_a_fold_back_is_drivable(tmp_path):
    rows = "\n".join(f"{x:.3f},{y:.3f}" for x, y in track_with_reverse(2.0))
    (tmp_path / "track.csv").write_text(f"x,y\n{rows}\n", encoding="utf-8")
    path = Waypoints(file=str(tmp_path / "track.csv"))
    assert float(path.course().lengths.sum()) == pytest.approx(19.75, abs=0.5)
    assert path.max_curvature < 0.2
    assert any("fold-back" in note for note in path.notes)
