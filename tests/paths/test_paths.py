"""Interface requirements of every reference path: consistency of `at` and of the laps."""

import json
import sys
from math import cos, hypot, inf, nan, pi, sin
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from agrobot_mj.core.errors import NotFiniteError
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.samples import sample_of, samples_at
from agrobot_mj.core.signals import Reference
from agrobot_mj.core.spec import every
from agrobot_mj.paths import (
    Circle,
    Contour,
    FigureEight,
    LaneChange,
    Line,
    Manoeuvre,
    Path,
    Sinusoid,
    Swaths,
    Timed,
    Waypoints,
    sample,
)
from agrobot_mj.paths.arc import SLOWEST_M_S, Pose, advance
from agrobot_mj.paths.route import SampledRoute, references_at

RAMPED = [
    *(Line(), Circle(), FigureEight()),
    Line(heading_deg=200, start_x_m=3, start_y_m=-4, length_m=50, speed_m_s=2.5, ramp_s=0),
    Circle(direction="right", radius_m=4, turns=3, speed_m_s=0.7),
    FigureEight(radius_m=6, straight_m=9, speed_m_s=1.7, turns=1, run_in_m=2),
]
TIMED = [cls() for cls in every(Path) if issubclass(cls, Timed)] + [
    Swaths(
        heading_deg=130, start_x_m=-5, start_y_m=8, length_m=30, run_in_m=5, swath_m=7, turn="u", first_turn="right"
    ),
    Swaths(length_m=25, run_in_m=5, swath_m=1.5, turn="u", turn_radius_m=2, count=13, speed_m_s=2, turn_speed_m_s=0.6),
    Contour(uphill_deg=20, first_uphill="right", length_m=40, swath_m=3, lateral_acceleration_m_s2=0.1),
    Sinusoid(amplitude_m=-4, wavelength_m=25, count=2, heading_deg=75, speed_m_s=3, acceleration_m_s2=1),
    LaneChange(offset_m=-4, double=True, heading_deg=-100, start_x_m=6, speed_m_s=2),
    Waypoints(smoothing_m=0.5, speed_m_s=1.4),
    Waypoints(corners="spline"),
    Waypoints(transition="none", corner_radius_m=7),
    *(
        Swaths(length_m=25, run_in_m=5, swath_m=swath, turn=turn, count=9, transition="clothoid")
        for turn in ("u", "omega", "k")
        for swath in (2.5, 6.5, 7.5, 9.0)
    ),
    Swaths(length_m=25, run_in_m=5, turn="k", first_turn="right", heading_deg=50, cusp_pause_s=0),
    Manoeuvre(heading_deg=77, start_x_m=3, cusp_pause_s=0),
]
SMOOTH = [
    FigureEight(transition="clothoid"),
    FigureEight(radius_m=4, straight_m=9, speed_m_s=1.7, turns=1, run_in_m=2, transition="clothoid", ramp_s=0),
    Circle(transition="clothoid", radius_m=4, direction="right", ramp_s=0),
]
RAMPED += SMOOTH
VARIANTS = RAMPED + TIMED
CONTINUOUS = [
    *SMOOTH,
    Waypoints(),
    *(path for path in TIMED if isinstance(path, Swaths) and path.transition == "clothoid"),
]
"""Paths without curvature steps."""
EPS = 1e-5


def times(path: Any) -> list[float]:
    """Return times over the whole path, including its start and a part after its end."""
    return [*np.linspace(0, 1.1 * path.duration_s, 400).tolist(), path.duration_s]


def signed_speed(r: Any) -> float:
    """Return the speed along the heading, negative in reverse."""
    return float(r.vx * cos(r.yaw) + r.vy * sin(r.yaw))


def reverses(path: Any) -> bool:
    """Return whether parts of the path are driven in reverse."""
    return isinstance(path, Timed) and bool((path.motion.course.directions < 0).any())


def test_path_tests_include_every_path_kind() -> None:
    assert {type(path) for path in VARIANTS} == set(every(Path))


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_compiled_references_of_a_path_equal_its_method_at_bit_for_bit(path):
    times = np.linspace(0.01, path.duration_s + 5.0, 400)
    found, expected = references_at(path, times), [path.at(t) for t in times.tolist()]
    assert np.array_equal(found, expected)
    samples = [sample_of(t, r) for t, r in zip(times.tolist(), expected, strict=True)]
    assert np.array_equal(samples_at(times, found), samples)


def test_references_use_the_overridden_method_at_of_a_path_subclass():
    class Shifted(FigureEight):
        def at(self, t):
            return super().at(t)._replace(x=7.0)

    class Faster(Sinusoid):
        def at(self, t):
            return super().at(2 * t)

    times = np.array([1.0, 2.0])
    assert (references_at(Shifted(), times)[:, 0] == 7.0).all()
    assert np.array_equal(references_at(Faster(), times), references_at(Sinusoid(), 2 * times))


def test_path_references_given_as_integers_are_converted_to_floats():
    class Parked(Sinusoid):
        def at(self, t):
            return Reference(5, 3, 0, 0, 0, 0, 0)

    found = references_at(Parked(), np.array([1.0, 2.0]))
    assert found.dtype == np.float64
    assert SampledRoute(Parked()).at(1.0).x == 5.0


def test_error_for_a_nan_path_reference_names_path_and_time():
    class Broken(Sinusoid):
        def course(self):
            course = super().course()
            return course._replace(start=course.start._replace(y=nan))

    with pytest.raises(NotFiniteError, match=r"the path \(sinusoid\) at t = 1.00 s: reference.y is nan"):
        references_at(Broken(), np.array([1.0]))


@pytest.mark.parametrize(("curvature", "distance", "sharpness"), [(inf, 1.0, 0.1), (0.1, inf, 0.1), (0.1, 1.0, inf)])
def test_infinite_clothoid_parameter_raises_a_value_error(curvature, distance, sharpness):
    with pytest.raises(ValueError, match="math domain error"):
        advance(Pose(0.0, 0.0, 0.0), curvature, distance, sharpness)


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_reference_velocity_is_along_the_heading_and_equals_position_rate(path: Any) -> None:
    for t in times(path)[1:]:
        before, now, after = path.at(t - EPS), path.at(t), path.at(t + EPS)
        assert (after.x - before.x) / (2 * EPS) == pytest.approx(now.vx, abs=1e-4)
        assert (after.y - before.y) / (2 * EPS) == pytest.approx(now.vy, abs=1e-4)
        speed = signed_speed(now)
        assert now.vx == pytest.approx(speed * cos(now.yaw), abs=1e-12)
        assert now.vy == pytest.approx(speed * sin(now.yaw), abs=1e-12)
        assert abs(speed) <= path.speed_m_s * (1 + 1e-9)
        assert speed > 0 or reverses(path)


@pytest.mark.parametrize("path", RAMPED, ids=repr)
def test_reference_speed_is_constant_after_the_initial_ramp(path: Any) -> None:
    for t in times(path)[1:]:
        speed = path.speed_m_s * (min(t / path.ramp_s, 1.0) if path.ramp_s else 1.0)
        assert hypot(path.at(t).vx, path.at(t).vy) == pytest.approx(speed)


@pytest.mark.parametrize("path", TIMED, ids=repr)
def test_reference_speed_reaches_but_does_not_exceed_its_limits(path: Any) -> None:
    grid = np.linspace(0, path.duration_s, 4000)
    references = [path.at(t) for t in grid.tolist()]
    v = np.array([hypot(r.vx, r.vy) for r in references])
    sideways = v**2 * np.abs([r.curvature for r in references])
    gained = np.abs(np.diff(v)) / np.diff(grid)
    assert sideways.max() <= path.lateral_acceleration_m_s2 * (1 + 1e-9)
    assert gained.max() <= path.acceleration_m_s2 * (1 + 1e-6)
    assert gained[:5] == pytest.approx(path.acceleration_m_s2)
    slowed = sideways.max() > 0.98 * path.lateral_acceleration_m_s2
    assert slowed or v.max() == pytest.approx(path.speed_m_s)


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_path_position_is_continuous(path: Any) -> None:
    """The distance between consecutive samples never exceeds the maximum speed times the interval."""
    grid = np.linspace(0, path.duration_s, 5000)
    steps = np.hypot(*np.diff(sample(path, grid), axis=0).T)
    assert steps.max() <= path.speed_m_s * (grid[1] - grid[0]) * (1 + 1e-9)


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_point_of_maximum_curvature_is_on_the_path(path: Any) -> None:
    place, grid = path.sharpest, np.linspace(0, path.duration_s, 20000)
    points = sample(path, grid)
    distance = np.concatenate(([0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    there = int(np.searchsorted(distance, place.distance))
    assert points[there] == pytest.approx((place.x, place.y), abs=0.1)
    near = [abs(path.at(t).curvature) for t in grid[max(there - 50, 0) : there + 50].tolist()]
    assert max(near) == pytest.approx(path.max_curvature, rel=1e-3)


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_path_is_unchanged_by_serialisation(path: Any) -> None:
    adapter: TypeAdapter[Any] = TypeAdapter(Path)
    again = adapter.validate_json(json.dumps(path.model_dump(mode="json")))
    assert again == path
    assert hash(again) == hash(path)
    assert again.at(12.3) == path.at(12.3)


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_path_evaluation_takes_at_most_three_times_as_long_as_for_a_circle(path: Any) -> None:
    def cost(of: Any) -> int:
        """Return the number of lines that 50 evaluations execute; a search along the path would increase it."""
        grid, executed = np.linspace(0, of.duration_s, 50).tolist(), 0

        def count(frame: Any, event: str, argument: Any) -> Any:
            nonlocal executed
            executed += event == "line"
            return count

        of.at(0.0)
        before = sys.gettrace()
        sys.settrace(count)
        try:
            for t in grid:
                of.at(t)
        finally:
            sys.settrace(before)
        return executed

    assert cost(path) < 3 * cost(Circle())


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_curvature_equals_heading_change_per_distance(path: Any) -> None:
    for t in times(path)[1:]:
        before, after = path.at(t - EPS), path.at(t + EPS)
        speed = signed_speed(path.at(t))
        turned = wrap(after.yaw - before.yaw)
        if abs(speed) > 1e-2:  # the distance is zero at a cusp
            low, high = sorted((before.curvature, after.curvature))
            assert low - 1e-4 <= turned / (2 * EPS * speed) <= high + 1e-4
        assert -pi < path.at(t).yaw <= pi
        assert abs(path.at(t).curvature) <= path.max_curvature * (1 + 1e-12)


@pytest.mark.parametrize("path", CONTINUOUS, ids=repr)
def test_steering_rate_on_clothoids_reaches_but_stays_within_its_limit(path: Any) -> None:
    L, grid = path.wheelbase_m, np.linspace(0, path.duration_s, 20001)
    kappa, rate = np.array([(r.curvature, r.curvature_rate) for r in map(path.at, grid.tolist())]).T
    steer_rate = np.degrees(np.diff(np.arctan(L * kappa)) / np.diff(grid))
    stated = np.degrees(L * rate / (1 + (L * kappa) ** 2))
    assert np.abs(stated).max() <= path.steer_rate_deg_s * (1 + 1e-9)
    assert np.abs(stated).max() > 0.95 * path.steer_rate_deg_s
    # A curvature step would cause a higher rate between samples.
    assert np.abs(steer_rate).max() <= path.steer_rate_deg_s * (1 + 1e-6)


@pytest.mark.parametrize("path", CONTINUOUS, ids=repr)
def test_curvature_rate_is_the_derivative_of_the_curvature(path: Any) -> None:
    for t in times(path)[1:]:
        before, now, after = path.at(t - EPS), path.at(t), path.at(t + EPS)
        slope = (after.curvature - before.curvature) / (2 * EPS)
        low, high = sorted((before.curvature_rate, after.curvature_rate))
        assert low - 1e-5 <= slope <= high + 1e-5
        assert low - 1e-3 <= now.curvature_rate <= high + 1e-3


@pytest.mark.parametrize("path", CONTINUOUS + [Manoeuvre(), Swaths(turn="k", length_m=40)], ids=repr)
def test_pose_equals_the_integral_of_speed_and_curvature(path: Any) -> None:
    """The reference integrates from the start by the trapezoidal rule."""
    starts = path.motion.times if isinstance(path, Timed) else []
    grid = np.unique(np.concatenate([np.linspace(0, path.duration_s, 30001), starts]))
    x, y, yaw, kappa, u = np.array(
        [(r.x, r.y, r.yaw, r.curvature, signed_speed(r)) for r in map(path.at, grid.tolist())]
    ).T

    def integral(values: Any) -> Any:
        return np.concatenate(([0.0], np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(grid))))

    tolerance = 1e-4 if path in CONTINUOUS else 3e-2  # curvature steps between grid points cause larger errors
    heading = yaw[0] + integral(u * kappa)
    assert np.abs(np.angle(np.exp(1j * (heading - yaw)))).max() < tolerance
    assert np.abs(x - x[0] - integral(u * np.cos(yaw))).max() <= 1e-4
    assert np.abs(y - y[0] - integral(u * np.sin(yaw))).max() <= 1e-4


@pytest.mark.parametrize("path", [path for path in TIMED if path.motion.course.cusps.any()], ids=repr)
def test_reference_stops_at_each_cusp_within_the_deceleration_limit(path: Any) -> None:
    motion, course = path.motion, path.motion.course
    turns = np.flatnonzero(np.diff(course.directions)) + 1
    assert turns.size > 0
    assert motion.speeds[turns] == pytest.approx(0.0, abs=1e-12)
    for k in turns.tolist():
        t, pause = motion.times[k], path.cusp_pause_s
        before, after = path.at(t - 1e-3), path.at(t + pause + 1e-3)
        assert signed_speed(before) * signed_speed(after) < 0
        for close in (before, after):
            assert 0 < hypot(close.vx, close.vy) <= 1e-3 * path.acceleration_m_s2 * (1 + 1e-6)
            assert wrap(close.yaw - path.at(t).yaw) == pytest.approx(0, abs=1e-6)
        if pause:
            standing = path.at(t + pause / 2)
            assert standing[2:4] == (0, 0)
            assert standing.curvature_rate == 0
    pauses = course.pauses.sum()
    assert pauses == pytest.approx(path.cusp_pause_s * turns.size)


def test_path_is_continuous_at_joints_within_a_micrometre() -> None:
    for path in (p for p in TIMED if isinstance(p, Timed)):
        for start in path.motion.times[1:].tolist():
            a, b = path.at(np.nextafter(start, 0.0)), path.at(start)
            assert hypot(a.x - b.x, a.y - b.y) < 1e-6
            assert abs(wrap(a.yaw - b.yaw)) < 1e-6


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_laps_cover_the_duration_without_gaps(path: Any) -> None:
    assert (path.turns_s[0][0] > 0) == (path.kind == "figure_eight" or (path.kind == "circle" and path in SMOOTH))
    assert path.turns_s[-1][1] == pytest.approx(path.duration_s)
    assert all(before[1] == after[0] for before, after in zip(path.turns_s, path.turns_s[1:], strict=False))


@pytest.mark.parametrize("path", [p for p in RAMPED if p.kind != "line"], ids=repr)
def test_each_lap_ends_at_its_start_point(path: Any) -> None:
    assert len(path.turns_s) == path.turns
    for start, end in path.turns_s:
        a, b = path.at(start), path.at(end)
        assert b[:2] == pytest.approx(a[:2], abs=1e-9)
        assert wrap(b.yaw - a.yaw) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_reference_is_at_rest_before_the_start_and_then_ramps_up(path: Any) -> None:
    start, before = path.at(0), path.at(-1.0)
    assert before == path.at(-2.0)
    assert before[:2] == pytest.approx(start[:2])
    assert before.vx == before.vy == 0
    ramp = path.ramp_s if path in RAMPED else 1.0
    full = path.speed_m_s if path in RAMPED else path.acceleration_m_s2
    end, later = path.at(ramp), path.at(ramp + 1e-9)
    distance = hypot(end.x - start.x, end.y - start.y)
    assert distance == pytest.approx(full * ramp / 2, rel=0.05)
    assert hypot(later.vx, later.vy) == pytest.approx(full)


@pytest.mark.parametrize("path", VARIANTS, ids=repr)
def test_sampled_path_equals_the_path_evaluated_at_each_time(path: Any) -> None:
    t = np.array([0.0, 1.0, 30.0])
    assert sample(path, t).shape == (3, 2)
    assert sample(path, t)[2] == pytest.approx((path.at(30.0).x, path.at(30.0).y))
    assert sample(path, np.array([])).shape == (0, 2)


@pytest.mark.parametrize("cls", every(Path))
@pytest.mark.parametrize("speed", [0, -1, 5.01, inf])
def test_path_speed_outside_0_to_5_m_s_is_rejected(cls: Any, speed: float) -> None:
    with pytest.raises(ValidationError, match="speed_m_s"):
        cls(speed_m_s=speed)
    assert cls(speed_m_s=5).speed_m_s == 5


def test_path_kind_selects_the_path_class() -> None:
    adapter: TypeAdapter[Any] = TypeAdapter(Path)
    for cls in every(Path):
        assert isinstance(adapter.validate_python({"kind": cls().kind}), cls)
    with pytest.raises(ValidationError, match="oval"):
        adapter.validate_python({"kind": "oval"})


@pytest.mark.parametrize("path", [Line, FigureEight, Sinusoid, LaneChange, Swaths, Contour])
def test_minimum_path_speed_is_accepted_and_a_lower_speed_rejected(path):
    assert 0 < path(speed_m_s=SLOWEST_M_S).duration_s < 1e9
    with pytest.raises(ValidationError, match="greater than or equal to"):
        path(speed_m_s=SLOWEST_M_S / 2)
