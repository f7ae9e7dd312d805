import numpy as np
import pytest

from agrobot_mj.recording.world.ground import smooth_corners
from agrobot_mj.recording.world.scene import MOST_LINES, contour_lines, contours, interval
from agrobot_mj.terrain import Ground, Slope
from agrobot_mj.terrain.grid import heights, plane

PATH = np.column_stack([np.linspace(0.0, 20.0, 50), np.zeros(50)])


@pytest.mark.parametrize("span", [0.5, 1.0, 3.7, 42.0, 1000.0])
def test_contour_interval_is_round_and_limits_the_number_of_lines(span):
    step = interval(-span / 3, 2 * span / 3)
    assert span / step <= MOST_LINES
    assert span / step > MOST_LINES / 3
    assert f"{step:e}"[0] in "125"
    assert float(f"{step:.0e}") == pytest.approx(step)


def test_contour_lines_run_across_a_slope_at_equal_heights():
    ground = Slope(grade_deg=10, direction_deg=30, half_size_m=30).ground()
    lines = contours(smooth_corners(ground, PATH))
    x, y, z = np.concatenate(lines).T
    step = interval(z.min() - 0.5, z.max() + 0.5)
    np.testing.assert_allclose(z, step * np.rint(z / step), atol=1e-9)
    np.testing.assert_allclose(z, heights(ground, x, y), atol=1e-9)
    along = np.concatenate([np.diff(line[:, :2], axis=0) for line in lines])
    uphill = np.array([np.cos(np.radians(30)), np.sin(np.radians(30))])
    np.testing.assert_allclose(along @ uphill, 0.0, atol=1e-9)


def test_contour_line_around_a_hill_is_closed():
    nodes = np.arange(-30.0, 30.5, 0.5)
    x, y = np.meshgrid(nodes, nodes)
    ground = Ground(-30.0, -30.0, 0.5, 2.0 * np.exp(-(x**2 + y**2) / 200))
    lines = contours(smooth_corners(ground, PATH))
    inside = [line for line in lines if np.abs(line[:, :2]).max() < 29.9]
    assert len(inside) > 3
    for line in inside:
        np.testing.assert_array_equal(line[0], line[-1])


def test_level_ground_and_furrows_have_no_contour_lines():
    nodes = np.arange(-30.0, 30.001, 0.05)
    relief = 0.06 * np.cos(2 * np.pi * nodes / 0.75)
    furrows = Ground(-30.0, -30.0, 0.05, np.repeat(relief[:, None], len(nodes), axis=1))
    for ground in (plane(0.0, 0.0, 500.0), furrows):
        assert contour_lines(smooth_corners(ground, PATH)) is None
