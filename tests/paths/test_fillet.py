"""Fillets: straight rows remain straight, and corners have the specified radius."""

from math import cos, hypot, pi, sqrt

import numpy as np
import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.paths import Waypoints, sample

FIELD = [(0, -6), (40, -6), (40, 6), (0, 6), (0, 18), (40, 18)]


def waypoints(tmp_path, rows, **keys):
    file = tmp_path / "route.csv"
    file.write_text("\n".join(",".join(str(value) for value in row) for row in rows) + "\n")
    path = Waypoints(file=str(file), **keys)
    path.check()  # reads the file
    return path


def points(path, count=40000):
    return sample(path, np.linspace(0, path.duration_s, count))


@pytest.mark.parametrize("transition", ["none", "clothoid"])
def test_path_between_rounded_corners_is_exactly_straight(tmp_path, transition):
    path = waypoints(tmp_path, FIELD, transition=transition)
    x, y = points(path).T
    for row in (-6, 6, 18):
        on = (np.abs(y - row) < 0.5) & (x > 8) & (x < 32)
        assert on.sum() > 1000
        assert np.abs(y[on] - row).max() < 1e-9
    assert y.min() > -6 - 1e-9


def test_rows_with_many_waypoints_are_exactly_straight(tmp_path):
    rows = [(float(x), -6.0) for x in range(0, 41, 2)] + [(40, 6)] + [(float(x), 6.0) for x in range(38, -1, -2)]
    path = waypoints(tmp_path, rows, corner_radius_m=2)
    x, y = points(path).T
    row = (y < 0) & (x < 37)
    assert np.abs(y[row] + 6).max() < 1e-9


def test_spline_through_waypoints_oscillates_along_a_straight_row(tmp_path):
    x, y = points(waypoints(tmp_path, FIELD, corners="spline")).T
    assert np.abs(y[(x > 8) & (x < 32) & (y < 0)] + 6).max() > 0.1


def test_rounded_corner_is_an_arc_of_the_specified_radius(tmp_path):
    path = waypoints(tmp_path, [(0, 0), (30, 0), (30, 30)], corner_radius_m=5, transition="none")
    assert path.max_curvature == pytest.approx(0.2)
    assert path.motion.distances[-1] == pytest.approx(2 * 25 + 5 * pi / 2)
    path_points = points(path)
    bend = path_points[(path_points[:, 0] > 25) & (path_points[:, 1] < 5)]
    assert np.hypot(bend[:, 0] - 25, bend[:, 1] - 5) == pytest.approx(5, abs=1e-9)
    assert np.hypot(*(path_points - (30, 0)).T).min() == pytest.approx(5 * (sqrt(2) - 1), abs=1e-3)


def test_rounded_gentle_corner_passes_its_waypoint_within_tolerance(tmp_path):
    angle = np.radians(8)
    rows = [(0, 0), (60, 0), (60 + 60 * np.cos(angle), 60 * np.sin(angle))]
    path = waypoints(tmp_path, rows, smoothing_m=0.1, transition="none")
    assert np.hypot(*(points(path) - rows[1]).T).min() == pytest.approx(0.1, abs=2e-3)
    assert 1 / path.max_curvature == pytest.approx(0.1 / (1 / cos(angle / 2) - 1))


def test_short_segments_reduce_first_the_corner_speed_then_the_radius(tmp_path):
    """Arcs with little space get short clothoids, at a speed within the limit of the steering rate."""
    roomy, tight, short = (
        waypoints(tmp_path, [(0, 0), (20, 0), (20, leg), (40, leg)], corner_radius_m=3) for leg in (20, 7.7, 5)
    )
    assert roomy.max_curvature == tight.max_curvature == pytest.approx(1 / 3)
    assert short.max_curvature == pytest.approx(1 / (0.8 * 2.5))
    sharp = [np.abs(path.course().sharpnesses).max() for path in (roomy, tight, short)]
    assert sharp[0] < 0.9 * sharp[1]
    in_bends = [path.course().speeds[path.course().curvatures != 0].min() for path in (roomy, tight, short)]
    assert in_bends[0] > in_bends[1] + 0.1
    for path in (roomy, tight, short):
        rates = [path.at(t).curvature_rate for t in np.linspace(0, path.duration_s, 20000).tolist()]
        assert np.degrees(1.4 * np.abs(rates).max()) <= 15 * (1 + 1e-9)


def test_closed_path_is_rounded_at_its_first_waypoint(tmp_path):
    path = waypoints(tmp_path, [(0, 0), (30, 0), (30, 20), (0, 20)], closed=True, laps=2, corner_radius_m=3)
    (_, half), (_, end) = path.turns_s
    for t in (half, end):
        assert path.at(t)[:2] == pytest.approx(path.at(0)[:2], abs=1e-9)
        assert path.at(t).yaw == pytest.approx(0, abs=1e-9)
    assert path.at(0).y == 0
    assert 3 < path.at(0).x < 5
    x, y = points(path).T
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((0, 30, 0, 20), abs=1e-6)


def test_waypoint_speeds_limit_the_speed_on_segments_and_corners(tmp_path):
    path = waypoints(tmp_path, [(0, 0, 1.0), (30, 0, 0.4), (30, 30, 1.0)], speed_m_s=2)
    for t in np.linspace(0, path.duration_s, 3000).tolist():
        r = path.at(t)
        along = r.x if r.y == 0 else 60 - (30 - r.y)
        if r.curvature:
            assert hypot(r.vx, r.vy) <= 0.4 + 1e-9
        elif r.y == 0:
            assert hypot(r.vx, r.vy) <= 1.0 - 0.6 * (along - 0.5) / 30 + 1e-9


def test_error_for_a_reversal_between_waypoints_names_the_waypoint(tmp_path):
    (tmp_path / "route.csv").write_text("0,0\n20,0\n5,0.05\n")
    scenario = tmp_path / "mine.toml"
    scenario.write_text('[path]\nkind = "waypoints"\nfile = "route.csv"\n')
    with pytest.raises(ScenarioError, match=r"path\.file: .*turns back by 180 deg at the waypoint \(20, 0\) m; remove"):
        load_scenario(scenario)
