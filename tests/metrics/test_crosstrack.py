"""Cross-track error on paths with varying speed, next to neighbouring swaths, and near crossings."""

from functools import cache
from math import hypot
from typing import Any

import numpy as np
import pytest
from turns import by_turns

from agrobot_mj.metrics.crosstrack import track
from agrobot_mj.paths import Contour, LaneChange, Sinusoid, Swaths, Waypoints

PATHS = [
    Swaths(length_m=40, swath_m=1.0, turn_radius_m=2.0, turn_speed_m_s=0.4),
    Swaths(length_m=40, swath_m=2.0, turn="u", count=7, first_turn="right", heading_deg=40),
    Contour(length_m=40, swath_m=6.5),
    Sinusoid(speed_m_s=3, lateral_acceleration_m_s2=0.2),
    LaneChange(),
    Waypoints(),
]


@cache
def fine_way(path: Any) -> tuple[Any, Any]:
    """Return closely spaced times and the distance driven until each time [m]."""
    fine = np.linspace(-1, path.duration_s + 20, 60000)
    points = np.array([path.at(s) for s in fine.tolist()])
    return fine, np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))))


LAGS = (0.0, -2.5, 1.5)  # Distance ahead of the reference [m]


@cache
def points_ahead(path: Any, ahead: Any) -> tuple[Any, Any]:
    """Return ticks and the reference points `ahead` metres along the path from the reference of each tick."""
    t = np.arange(0, path.duration_s, 0.05)
    fine, way = fine_way(path)
    there = np.interp(np.clip(np.interp(t, fine, way) + ahead, 1e-3, None), way, fine)
    return t, np.array([path.at(s) for s in there.tolist()])


def points_beside(path: Any, ahead: Any, left: Any) -> tuple[Any, Any, Any]:
    """Return ticks and points at a signed distance `left` from the path, `ahead` metres beyond the reference."""
    t, r = points_ahead(path, ahead)
    return t, r[:, 0] - left * np.sin(r[:, 4]), r[:, 1] + left * np.cos(r[:, 4])


@pytest.mark.parametrize(("path", "ahead"), by_turns([pytest.param(path, id=repr(path)) for path in PATHS], LAGS))
def test_cross_track_error_of_a_constant_offset_is_independent_of_lag(path: Any, ahead: float) -> None:
    for left in (-0.8, 0.45):
        t, x, y = points_beside(path, ahead, left)
        assert track(path, t, x, y).offset == pytest.approx(left, abs=4e-3)


@pytest.mark.parametrize("path", PATHS, ids=repr)
def test_path_time_is_the_time_of_the_nearest_reference_point(path: Any) -> None:
    t, x, y = points_beside(path, 0.0, 0.3)
    found = track(path, t, x, y).time
    places = np.array([path.at(s)[:2] for s in found.tolist()])
    wanted = np.array([path.at(s)[:2] for s in t.tolist()])
    assert np.hypot(*(places - wanted).T).max() < 0.1


@pytest.mark.parametrize("lag", [0.0, 3.0])
def test_nearest_point_does_not_jump_to_the_neighbouring_swath(lag: float) -> None:
    """The tractor is closer to the neighbouring line, but the error refers to its own line."""
    path = Swaths(length_m=40, swath_m=1.0, turn_radius_m=2.5)
    for start, end in path.passes_s:
        t = np.arange(start + 2, end - 0.05, 0.05)
        references = [path.at(s) for s in t.tolist()]
        forward = 1.0 if references[0].vx > 0 else -1.0
        x = np.array([r.x for r in references]) - forward * lag
        for left in (-0.9, 0.9):
            y = np.array([r.y for r in references]) + left
            assert track(path, t, x, y).offset == pytest.approx(forward * left, abs=1e-6)


@pytest.mark.parametrize("path", PATHS, ids=repr)
def test_nearest_path_point_is_found_far_behind_the_reference(path: Any) -> None:
    t, _, _ = points_beside(path, 0.0, 0.0)
    behind = np.array([path.at(0.6 * s) for s in t.tolist()])
    x, y = behind[:, 0] - 0.2 * np.sin(behind[:, 4]), behind[:, 1] + 0.2 * np.cos(behind[:, 4])
    found = track(path, t, x, y)
    assert found.offset == pytest.approx(0.2, abs=4e-3)
    assert found.time[-1] < path.duration_s - 5


def test_cross_track_error_is_correct_again_after_a_long_position_loss() -> None:
    path = Swaths(length_m=40, swath_m=3.0, turn_radius_m=2.0)
    t, x, y = points_beside(path, -1.0, 0.3)
    lost = slice(len(t) // 4, 3 * len(t) // 4)
    x[lost] = np.nan
    found = track(path, t, x, y).offset
    assert np.isnan(found[lost]).all()
    assert np.delete(found, np.r_[lost]) == pytest.approx(0.3, abs=4e-3)


def test_cross_track_error_at_path_ends_uses_a_straight_extension() -> None:
    path = LaneChange(straight_m=15)
    t = np.array([0.0, 0.0, path.duration_s + 5])
    end = path.at(t[-1])
    found = track(path, t, np.array([-0.5, 0.5, end.x + 1]), np.array([0.2, -0.1, end.y - 0.3]))
    assert found.offset == pytest.approx([0.2, -0.1, -0.3], abs=1e-6)


def test_cross_track_error_is_missing_without_log_rows_or_positions() -> None:
    assert track(LaneChange(), *(np.empty(0),) * 3).offset.size == 0
    lost = track(LaneChange(), np.array([1.0, 2.0]), np.array([np.nan, 1e300]), np.array([0.0, np.inf]))
    assert np.isnan(lost.offset).all()
    assert np.isnan(lost.time).all()


def test_nearest_path_point_stays_on_the_driven_branch_at_a_crossing() -> None:
    path = Waypoints()
    grid = np.arange(0, path.duration_s, 0.05)
    points = np.array([path.at(s)[:2] for s in grid.tolist()])
    apart = np.abs(grid[:, None] - grid[None, :]) > 40
    distance = np.hypot(points[:, None, 0] - points[None, :, 0], points[:, None, 1] - points[None, :, 1])
    first, second = np.unravel_index(np.where(apart, distance, np.inf).argmin(), distance.shape)
    assert distance[first, second] < 5, "the default way comes near itself"
    for crossing in (first, second):
        t = grid[max(crossing - 60, 0) : crossing + 60]
        r = np.array([path.at(s) for s in t.tolist()])
        x, y = r[:, 0] - 1.2 * np.sin(r[:, 4]), r[:, 1] + 1.2 * np.cos(r[:, 4])
        assert track(path, t, x, y).offset == pytest.approx(1.2, abs=5e-3)
    assert hypot(*points[0]) < 1
