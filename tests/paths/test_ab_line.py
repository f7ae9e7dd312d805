"""AB lines of AgOpenGPS as paths: part inside the field, and extension of lines without a field."""

from math import atan2, cos, pi, sin

import numpy as np
import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.paths.imports.shapes import parts_inside
from agrobot_mj.scenario.hints import hints
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.storage import files_of_run

U_SHAPE = ((0, 0), (90, 0), (90, 60), (60, 60), (60, 20), (40, 20), (40, 60), (0, 60))


def folder(path, a, b, ring=U_SHAPE, name="AB 1"):
    """Write the folder of a field with an AB line through the points `a` and `b` [m]."""
    heading = (pi / 2 - atan2(b[1] - a[1], b[0] - a[0])) % (2 * pi)
    text = f"$TrackLines\r\n{name}\r\n{heading:.8f}\r\n{a[0]},{a[1]}\r\n{b[0]},{b[1]}\r\n0\r\n2\r\nTrue\r\n0\r\n"
    (path / "TrackLines.txt").write_text(text, newline="")
    if ring is not None:
        boundary(path, ring)
    return path


def boundary(path, *rings, drivable="False"):
    """Write the boundary of a field: the outer ring, and the inner rings."""
    text = "$Boundary\r\n"
    for ring in rings:
        text += f"{drivable}\r\n{len(ring)}\r\n" + "".join(f"{x:.3f},{y:.3f},0.00000\r\n" for x, y in ring)
    (path / "Boundary.txt").write_text(text, newline="")


def scenario(path):
    keys = {"path.kind": "waypoints", "path.file": str(path / "TrackLines.txt"), "plant.kind": "bicycle"}
    return load_scenario("straight_line", {"duration_s": None, **keys})


def ends(path):
    """Return the first and the last waypoint of the path."""
    points = scenario(path).path.waypoints()
    return points[[0, -1]].round(3).tolist()


def test_ab_line_runs_from_edge_to_edge_of_the_field_in_its_direction(tmp_path):
    path = folder(tmp_path, (20, 10), (30, 10))
    assert ends(path) == [[0.0, 10.0], [90.0, 10.0]]
    assert "path.file: the AB line is cut at Boundary.txt" in hints(scenario(path))
    assert ends(folder(tmp_path, (30, 10), (20, 10))) == [[90.0, 10.0], [0.0, 10.0]]


def test_longest_part_of_an_ab_line_in_a_concave_field_is_used(tmp_path):
    # at y = 40 the field has two parts: 40 m wide on the left, and 30 m wide on the right
    assert ends(folder(tmp_path, (70, 40), (80, 40))) == [[0.0, 40.0], [40.0, 40.0]]
    wide = ((0, 0), (90, 0), (90, 60), (75, 60), (75, 20), (5, 20), (5, 60), (0, 60))
    assert ends(folder(tmp_path, (70, 40), (80, 40), wide)) == [[75.0, 40.0], [90.0, 40.0]]
    # along the diagonal, the field ends at the notch, whose left edge is at x = 40
    assert np.array(ends(folder(tmp_path, (5, 5), (10, 10)))) == pytest.approx(np.array([[0, 0], [40, 40]]), abs=0.01)


@pytest.mark.parametrize("drivable", ["True", "False"])
def test_ab_line_is_cut_at_the_inner_rings_of_the_boundary(tmp_path, drivable):
    path = folder(tmp_path, (20, 10), (30, 10))
    square, island = ((0, 0), (90, 0), (90, 60), (0, 60)), ((30, 5), (40, 5), (40, 15), (30, 15))
    boundary(path, square, island, drivable=drivable)
    assert ends(path) == [[40.0, 10.0], [90.0, 10.0]]
    told = "path.file: the AB line is cut at Boundary.txt, and the longest of 2 parts is used"
    assert told in hints(scenario(path))


def test_parts_inside_rings_agree_with_shapely():
    shapely = pytest.importorskip("shapely")
    rng, count = np.random.default_rng(4), 0
    for _ in range(200):
        angles = np.sort(rng.uniform(0, 2 * pi, 12))
        ring = rng.uniform(30, 90, (12, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])
        island = rng.uniform(-10, 10, 2) + [(0, 0), (12, 0), (6, 9)]
        area = shapely.Polygon(ring, [island])
        line = rng.uniform(-100, 100, (4, 2)).round()
        if area.is_valid:
            parts = shapely.MultiLineString([shapely.LineString(part) for part in parts_inside(line, [ring, island])])
            assert parts.length == pytest.approx(shapely.LineString(line).intersection(area).length, abs=1e-6)
            assert parts.difference(area.buffer(1e-6)).is_empty
            count += 1
    assert count > 50


def test_parts_inside_rings_with_common_corners_agree_with_shapely():
    """On a grid of integers, lines pass through corners, run along sides, and touch the rings."""
    shapely = pytest.importorskip("shapely")
    rng, count = np.random.default_rng(5), 0
    ring = np.array([(0, 0), (8, 0), (8, 8), (5, 8), (5, 4), (3, 4), (3, 8), (0, 8)])
    for _ in range(400):
        island, line = rng.integers(0, (9, 5), (3, 2)), rng.integers(-2, 10, (2, 2))
        area = shapely.Polygon(ring, [island])
        if area.is_valid and (line[0] != line[1]).any():
            parts = [shapely.LineString(part).length for part in parts_inside(line, [ring, island])]
            assert sum(parts) == pytest.approx(shapely.LineString(line).intersection(area).length, abs=1e-6)
            count += 1
    assert count > 100


@pytest.mark.parametrize("turned", np.linspace(0.0, 2 * pi, 13))
def test_line_along_a_side_of_the_field_ends_at_its_corners(turned):
    ring = np.array([(0, 0), (90, 0), (90, 60), (0, 60)]) @ [[cos(turned), sin(turned)], [-sin(turned), cos(turned)]]
    along = ring[1] - ring[0]
    (part,) = parts_inside(np.array([ring[0] - 11 * along, ring[0] + 0.3 * along, ring[1] + 11 * along]), [ring])
    assert part[[0, -1]] == pytest.approx(ring[:2], abs=1e-6)


def test_repeated_points_of_a_line_are_omitted():
    (part,) = parts_inside(np.array([(5, 5), (5, 5), (20, 5)]), [np.array([(0, 0), (10, 0), (10, 10), (0, 10)])])
    assert part == pytest.approx(np.array([(5, 5), (10, 5)]))


def test_ab_line_without_a_field_extends_200_m_beyond_its_points(tmp_path):
    path = folder(tmp_path, (20, 10), (30, 10), ring=None)
    assert ends(path) == [[-180.0, 10.0], [230.0, 10.0]]
    told = "path.file: the AB line extends 200 m beyond A and B, because there is no Boundary.txt"
    assert told in hints(scenario(path))


def test_ab_line_outside_the_field_is_rejected_with_the_fix(tmp_path):
    with pytest.raises(ScenarioError, match=r"the AB line does not cross the field in Boundary\.txt; choose another"):
        scenario(folder(tmp_path, (0, 80), (10, 80)))


def test_damaged_boundary_of_an_ab_line_is_rejected_with_the_fix(tmp_path):
    folder(tmp_path, (20, 10), (30, 10))
    (tmp_path / "Boundary.txt").write_text("$Boundary\nFalse\n9\n0,0,0\n")
    with pytest.raises(ScenarioError, match="declares 9 points, but contains fewer"):
        scenario(tmp_path)


def test_changed_boundary_changes_the_path(tmp_path):
    path = folder(tmp_path, (20, 10), (30, 10))
    assert ends(path)[1] == [90.0, 10.0]
    boundary(path, ((0, 0), (70, 0), (70, 60), (0, 60)))
    assert ends(path)[1] == [70.0, 10.0]


def test_run_folder_contains_the_boundary_of_the_ab_line(tmp_path):
    path = scenario(folder(tmp_path, (20, 10), (30, 10)))
    assert {"TrackLines.txt", "Boundary.txt"} <= set(files_of_run(path))
