"""The contract of every reference path: what `at` says agrees with itself and with the turns."""

from math import cos, hypot, inf, pi, sin
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from agrobot_mj.geometry import wrap
from agrobot_mj.paths import Circle, FigureEight, Line, Path, sample
from agrobot_mj.spec import every

VARIANTS = [cls() for cls in every(Path)] + [
    Line(heading_deg=200, start_x_m=3, start_y_m=-4, length_m=50, speed_m_s=2.5, ramp_s=0),
    Circle(direction="right", radius_m=4, turns=3, speed_m_s=0.7),
    FigureEight(radius_m=6, straight_m=9, speed_m_s=1.7, turns=1, run_in_m=2),
]
EPS = 1e-5


def times(path: Any) -> list[float]:
    """Times over the whole path, its beginning and a stretch beyond its end included."""
    return [*np.linspace(0, 1.1 * path.duration_s, 400).tolist(), path.duration_s]


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_velocity_is_the_derivative_of_position_and_constant_after_the_ramp(path: Any) -> None:
    for t in times(path)[1:]:
        before, now, after = path.at(t - EPS), path.at(t), path.at(t + EPS)
        assert (after.x - before.x) / (2 * EPS) == pytest.approx(now.vx, abs=1e-4)
        assert (after.y - before.y) / (2 * EPS) == pytest.approx(now.vy, abs=1e-4)
        speed = path.speed_m_s * (min(t / path.ramp_s, 1.0) if path.ramp_s else 1.0)
        assert now.vx == pytest.approx(speed * cos(now.yaw))
        assert now.vy == pytest.approx(speed * sin(now.yaw))


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_curvature_is_the_change_of_heading_over_distance(path: Any) -> None:
    for t in times(path)[1:]:
        before, after = path.at(t - EPS), path.at(t + EPS)
        speed = hypot(path.at(t).vx, path.at(t).vy)
        turned = wrap(after.yaw - before.yaw)
        low, high = sorted((before.curvature, after.curvature))
        assert low - 1e-4 <= turned / (2 * EPS * speed) <= high + 1e-4
        assert -pi < path.at(t).yaw <= pi
        assert abs(path.at(t).curvature) <= path.max_curvature


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_turns_cover_the_duration_and_join(path: Any) -> None:
    assert (path.turns_s[0][0] > 0) == (getattr(path, "run_in_m", 0) > 0)
    assert path.turns_s[-1][1] == pytest.approx(path.duration_s)
    assert all(before[1] == after[0] for before, after in zip(path.turns_s, path.turns_s[1:], strict=False))


@pytest.mark.parametrize("path", [p for p in VARIANTS if p.kind != "line"], ids=repr)
def test_each_turn_closes(path: Any) -> None:
    assert len(path.turns_s) == path.turns
    for start, end in path.turns_s:
        a, b = path.at(start), path.at(end)
        assert b[:2] == pytest.approx(a[:2], abs=1e-9)
        assert wrap(b.yaw - a.yaw) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_it_waits_before_the_start_and_ramps_up_from_rest(path: Any) -> None:
    start, before = path.at(0), path.at(-1.0)
    assert before == path.at(-2.0)
    assert before[:2] == pytest.approx(start[:2])
    assert before.vx == before.vy == 0
    end, later = path.at(path.ramp_s), path.at(path.ramp_s + 1.0)
    way = hypot(end.x - start.x, end.y - start.y)
    assert way == pytest.approx(path.speed_m_s * path.ramp_s / 2, rel=0.05)
    assert hypot(later.vx, later.vy) == pytest.approx(path.speed_m_s)


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_sample_gives_the_points_of_at(path: Any) -> None:
    t = np.array([0.0, 1.0, 30.0])
    assert sample(path, t).shape == (3, 2)
    assert sample(path, t)[2] == pytest.approx((path.at(30.0).x, path.at(30.0).y))
    assert sample(path, np.array([])).shape == (0, 2)


@pytest.mark.parametrize("cls", every(Path))
@pytest.mark.parametrize("speed", [0, -1, 5.01, inf])
def test_speed_must_be_positive_and_at_most_5(cls: Any, speed: float) -> None:
    with pytest.raises(ValidationError, match="speed_m_s"):
        cls(speed_m_s=speed)
    assert cls(speed_m_s=5).speed_m_s == 5


def test_the_kind_selects_the_path() -> None:
    adapter: TypeAdapter[Any] = TypeAdapter(Path)
    for cls in every(Path):
        assert isinstance(adapter.validate_python({"kind": cls().kind}), cls)
    with pytest.raises(ValidationError, match="oval"):
        adapter.validate_python({"kind": "oval"})
