"""Shape of each path compared with independently computed geometry."""

from math import atan, atan2, hypot, pi

import numpy as np
import pytest

from agrobot_mj.paths import Circle, FigureEight, Line, sample


def test_line_path_ends_after_its_configured_length() -> None:
    line = Line(start_x_m=1, start_y_m=2, heading_deg=90, length_m=30, speed_m_s=1.5, ramp_s=0)
    assert line.duration_s == 20
    assert line.at(20)[:4] == pytest.approx((1, 32, 0, 1.5))


@pytest.mark.parametrize(("direction", "side"), [("left", 1), ("right", -1)])
def test_circle_path_has_a_constant_radius(direction: str, side: int) -> None:
    circle = Circle(radius_m=7, direction=direction, ramp_s=0)
    points = sample(circle, np.linspace(0, circle.duration_s, 100))
    assert np.hypot(points[:, 0], points[:, 1] - side * 7) == pytest.approx(7)
    assert circle.at(0)[:4] == pytest.approx((0, 0, 1.2, 0))
    assert circle.at(circle.duration_s / 8)[:2] == pytest.approx((7, side * 7))
    assert circle.at(0).curvature == pytest.approx(side / 7)


def test_default_figure_eight_lap_takes_120_s_as_in_the_paper() -> None:
    eight = FigureEight(ramp_s=0, run_in_m=0)
    arc = 2 * pi - 2 * atan(14 / 10)
    assert eight.turns_s[0][1] == pytest.approx((2 * 28 + 2 * 10 * arc) / 1.2)
    assert eight.turns_s[0][1] == pytest.approx(119.7, abs=0.05)
    assert len(eight.turns_s) == 2


def test_figure_eight_returns_to_the_crossing_after_half_a_lap() -> None:
    eight = FigureEight(ramp_s=0, run_in_m=0)
    start, half_way = eight.at(0), eight.at(eight.turn_s / 2)
    assert start[:2] == pytest.approx((0, 0))
    assert half_way[:2] == pytest.approx((0, 0), abs=1e-12)
    assert start.yaw == pytest.approx(atan2(10, 14))
    assert half_way.yaw == pytest.approx(pi - atan2(10, 14))
    assert start.curvature == half_way.curvature == 0


def test_figure_eight_consists_of_two_straights_and_two_arcs() -> None:
    eight, centre = FigureEight(), hypot(14, 10)
    for t in np.linspace(0, eight.turn_s, 1000).tolist():
        r = eight.at(t)
        if r.curvature == 0:
            assert abs(r.x * 10) == pytest.approx(abs(r.y * 14), abs=1e-9)
            assert hypot(r.x, r.y) <= 14 + 1e-9
        else:
            side = 1 if r.x > 0 else -1
            assert hypot(r.x - side * centre, r.y) == pytest.approx(10)
            assert r.curvature == pytest.approx(-side / 10)
    xs, ys = sample(eight, np.linspace(0, eight.turn_s, 5001)).T
    assert (xs.max(), xs.min()) == pytest.approx((centre + 10, -centre - 10), abs=1e-3)
    assert (ys.max(), ys.min()) == pytest.approx((10, -10), abs=1e-3)


def test_speed_ramp_adds_half_of_its_duration_to_the_travel_time() -> None:
    at_once, ramped = FigureEight(ramp_s=0, run_in_m=0), FigureEight(ramp_s=6, run_in_m=0)
    assert ramped.duration_s == pytest.approx(at_once.duration_s + 3)
    assert ramped.turns_s[0] == pytest.approx((0, at_once.turn_s + 3))
    assert ramped.turns_s[1][1] - ramped.turns_s[1][0] == pytest.approx(at_once.turn_s)
    assert ramped.at(50)[:4] == pytest.approx(at_once.at(47)[:4])


def test_first_lap_starts_at_the_crossing_after_the_run_in() -> None:
    eight = FigureEight()
    begins, ends = eight.turns_s[0]
    assert begins == pytest.approx(14 / 1.2 + eight.ramp_s / 2)
    assert eight.at(begins)[:2] == pytest.approx((0, 0), abs=1e-9)
    assert ends - begins == pytest.approx(eight.turn_s)
    assert hypot(*eight.at(0)[:2]) == pytest.approx(14)
    assert eight.at(0).yaw == pytest.approx(eight.at(begins).yaw)
    short = FigureEight(run_in_m=0.6)
    assert short.at(short.turns_s[0][0])[:2] == pytest.approx((0, 0), abs=1e-9)
    with pytest.raises(ValueError, match="run_in_m"):
        FigureEight(run_in_m=14.5)
