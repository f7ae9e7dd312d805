import numpy as np
import pytest
from recorded import Recorded, replay

from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording

ELLIPSE = "/world/belief"


def rotated(quaternion, v):
    """Return `v` (3,) rotated by the quaternion (x, y, z, w)."""
    x, y, z, w = quaternion
    axis = np.array([x, y, z])
    t = 2 * np.cross(axis, v)
    return v + w * t + np.cross(axis, t)


def test_covariance_ellipse_is_three_sigma_of_the_position(eight):
    times, places = eight.column(ELLIPSE, "Ellipsoids3D:centers")
    _, sizes = eight.column(ELLIPSE, "Ellipsoids3D:half_sizes")
    _, turns = eight.column(ELLIPSE, "Ellipsoids3D:quaternions")
    np.testing.assert_array_equal(times, np.rint(eight.log.column("t") * 1e9))
    column = eight.log.column
    centre = np.array(places)[:, 0, :2]
    np.testing.assert_allclose(centre, np.column_stack([column("rear_x_hat"), column("rear_y_hat")]), atol=1e-5)
    for k in range(0, len(times), 50):
        first = rotated(turns[k][0], np.array([1.0, 0, 0]))[:2]
        second = rotated(turns[k][0], np.array([0, 1.0, 0]))[:2]
        a, b, thick = sizes[k][0]
        covariance = (a / 3) ** 2 * np.outer(first, first) + (b / 3) ** 2 * np.outer(second, second)
        expected = [[column("p_xx")[k], column("p_xy")[k]], [column("p_xy")[k], column("p_yy")[k]]]
        np.testing.assert_allclose(covariance, expected, rtol=1e-3, atol=1e-3 * column("p_xx")[k])
        assert thick < 0.01 < max(a, b)


def test_covariance_ellipse_is_parallel_to_the_slope(tmp_path):
    path = tmp_path / "run.rrd"
    over = {"duration_s": 2, "terrain.kind": "slope", "terrain.grade_deg": 12, "terrain.direction_deg": 30}
    run(load_scenario("straight_line", over), (Recording(path),))
    recorded = Recorded(path)
    _, turns = recorded.column(ELLIPSE, "Ellipsoids3D:quaternions")
    _, places = recorded.column(ELLIPSE, "Ellipsoids3D:centers")
    g, d = np.tan(np.radians(12)), np.radians(30)
    normal = np.array([-g * np.cos(d), -g * np.sin(d), 1.0])
    np.testing.assert_allclose(rotated(turns[-1][0], [0, 0, 1.0]), normal / np.linalg.norm(normal), atol=1e-4)
    x, y, z = places[-1][0]
    assert 0.0 < z - g * (x * np.cos(d) + y * np.sin(d)) < 0.05


def test_no_ellipse_is_drawn_without_a_covariance(short, tmp_path):
    short.column("p_xy")[30:40] = np.nan
    times, _ = replay(short, tmp_path / "run.rrd").column(ELLIPSE, "Ellipsoids3D:centers")
    ticks = times // 50_000_000
    assert set(range(len(short.column("t")))) - set(ticks.tolist()) == set(range(30, 40))


def test_covariance_ellipse_grows_during_a_gnss_loss(tmp_path):
    path = tmp_path / "run.rrd"
    faults = [{"kind": "gnss_loss", "start_s": 4, "end_s": 9}]
    run(load_scenario("straight_line", {"duration_s": 10, "fault": faults}), (Recording(path),))
    _, sizes = Recorded(path).column(ELLIPSE, "Ellipsoids3D:half_sizes")
    largest = np.array(sizes)[:, 0].max(axis=1)
    assert largest[178] > 3 * largest[78]
    assert largest[-1] == pytest.approx(largest[78], rel=0.5)
