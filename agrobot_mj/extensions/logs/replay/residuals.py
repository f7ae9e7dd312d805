"""Residuals of yaw rate and position between a replay and its recording, and residuals of a kinematic model.

The initial pose is fitted to the first metres of recorded positions, because a single antenna gives no heading. During
the replay, small errors of the yaw rate accumulate. Therefore rigid motions align windows of a few seconds with the
recorded track. The alignment separates errors of the plant from errors of the initial pose.
"""

from collections.abc import Iterator, Sequence
from math import atan, isfinite, nan
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from agrobot_mj.core.geometry import from_heading, wrap
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.driving import Driven, Pose
from agrobot_mj.extensions.logs.series import LEAST_SPEED, TimeSeries, chords

START_M = 10.0  # Length of the recorded track to which the initial pose is fitted [m]
WINDOW_S = 10.0  # Length of a window [s], about the duration of one bend
STRETCH_S = 1.0
"""Time between the positions for computing track lengths [s]: long enough to suppress noise, but shorter than bends."""
LARGEST_LAG_S = 0.5  # Maximum lag between two yaw rates that is considered [s]


class Rigid(NamedTuple):
    """Rigid motion of the plane: rotation and translation."""

    turn: float  # Rotation [rad], counter-clockwise
    shift: Array  # Translation after the rotation [m], shape (2,)

    def of(self, points: Array) -> Array:
        """Return `points` (n, 2) after the rotation and the translation [m]."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        moved: Array = points @ np.array([[c, s], [-s, c]]) + self.shift
        return moved


def rigid(points: Array, onto: Array) -> Rigid:
    """Return the rigid motion of `points` (n, 2) with the minimum sum of squared distances to `onto` (n, 2)."""
    a, b = points - points.mean(axis=0), onto - onto.mean(axis=0)
    turn = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    at_origin = Rigid(turn, np.zeros(2))
    return Rigid(turn, onto.mean(axis=0) - at_origin.of(points.mean(axis=0)[None])[0])


def refine_pose(pose: Pose, recording: FieldRecording, driven: Driven) -> Pose:
    """Return the initial pose, corrected so that the first metres of a replay fit the recorded positions. Without
    sufficient positions, the pose is unchanged."""
    fixes = _first_metres(recording)
    if fixes is None or len(driven.t) < 2 or driven.t[-1] < fixes.t[-1]:
        return pose
    at = np.column_stack([np.interp(fixes.t, driven.t, each) for each in driven.point.T])
    found = rigid(at, fixes.value)
    x, y = found.of(np.array([pose[:2]]))[0]
    return float(x), float(y), wrap(pose[2] + found.turn)


def first_metres_end(recording: FieldRecording) -> float:
    """Return the time shortly after the first `START_M` metres [s], or the end time of a recording without
    positions."""
    fixes = _first_metres(recording)
    return recording.end if fixes is None else min(float(fixes.t[-1]) + 0.1, recording.end)


def _first_metres(recording: FieldRecording) -> TimeSeries | None:
    """Return the recorded positions on the first `START_M` metres of the track, or None if there are too few."""
    if recording.position is None:
        return None
    fixes = recording.position.between(recording.start, recording.end)
    t = np.arange(recording.start, recording.end, 0.05)
    way = np.cumsum(np.abs(np.interp(t, *recording.speed))) * 0.05
    first = np.interp(fixes.t, t, way) <= START_M
    first[:4] = True
    return TimeSeries(fixes.t[first], fixes.value[first]) if len(fixes.t) >= 4 else None


def start_pose(recording: FieldRecording, wheelbase: float) -> Pose:
    """Return the initial pose of the rear-axle centre R, fitted to the first positions. Without positions, the pose is
    at the origin with the recorded heading."""
    fixes = _first_metres(recording)
    if fixes is None:
        return 0.0, 0.0, float(recording.heading.at(np.array([recording.start]))[0]) if recording.heading else 0.0
    t, yaw, point = kinematic(recording, wheelbase)
    found = rigid(np.column_stack([np.interp(fixes.t, t, each) for each in point.T]), fixes.value)
    psi, (ahead, left, _) = wrap(yaw[0] + found.turn), recording.arm
    x, y = found.of(point[:1])[0]
    east, north = from_heading(psi, ahead, left)
    return float(x) - east, float(y) - north, psi


def kinematic(recording: FieldRecording, wheelbase: float) -> tuple[Array, Array, Array]:
    """Return times [s], yaw [rad] and positions of the recorded point (n, 2) [m] for a model without slip. The model
    follows the recorded wheel angle or, without a wheel angle, the recorded yaw rate."""
    t = np.arange(recording.start, recording.end, 0.02)
    u = np.interp(t, *recording.speed)
    if recording.steer is not None:
        rate = u * np.tan(recording.steer.at(t)) / wheelbase
    else:
        r = recording.yaw_rate
        rate = np.interp(t, *r) if r is not None else np.zeros(len(t))
    yaw = cumulative_trapezoid(rate, t, initial=0)
    (ahead, left, _), c, s = recording.arm, np.cos(yaw), np.sin(yaw)
    x, y = (cumulative_trapezoid(u * each, t, initial=0) for each in (c, s))
    return t, yaw, np.column_stack([x + ahead * c - left * s, y + ahead * s + left * c])


Replayed = tuple[FieldRecording, Driven]  # Segment of a recording and its replay


def metrics(pieces: Sequence[Replayed], wheelbase: float) -> dict[str, Any]:
    """Return the metrics of a replay over all segments [SI, rad]. Metrics without sufficient data are None."""
    speeds = [driven.speed - np.interp(driven.t, *recording.speed) for recording, driven in pieces]
    steers = [driven.steer - recording.steer.at(driven.t) for recording, driven in pieces if recording.steer]
    return {
        "outcome": next((driven.outcome for _, driven in pieces if driven.outcome != "completed"), "completed"),
        "start_s": pieces[0][0].start,
        "duration_s": float(sum(driven.t[-1] - driven.t[0] for _, driven in pieces)),
        "way_m": float(sum(_way(recording, driven) for recording, driven in pieces)),
        "speed_rms": _rms(np.concatenate(speeds)),
        "steer_rms": _rms(np.concatenate(steers)) if steers else None,
        "yaw_rate": _yaw_rate(pieces, wheelbase),
        "position": _position(pieces),
    }


def _way(recording: FieldRecording, driven: Driven) -> float:
    if len(driven.t) < 2:
        return 0.0
    return float(np.abs(np.interp(driven.t, *recording.speed)).sum() * np.median(np.diff(driven.t)))


def _yaw_rate(pieces: Sequence[Replayed], wheelbase: float) -> dict[str, Any] | None:
    pairs = [
        (moving(recording, recording.yaw_rate.between(driven.t[0], driven.t[-1])), recording, driven)
        for recording, driven in pieces
        if recording.yaw_rate is not None
    ]
    pairs = [each for each in pairs if len(each[0].t) >= 8]
    if not pairs:
        return None
    value = np.concatenate([seen.value for seen, *_ in pairs])
    model = np.concatenate([np.interp(seen.t, driven.t, driven.yaw_rate) for seen, _, driven in pairs])
    slipless = [
        np.interp(seen.t, *recording.speed) * np.tan(recording.steer.at(seen.t)) / wheelbase - seen.value
        for seen, recording, _ in pairs
        if recording.steer is not None
    ]
    off, spread = model - value, float(np.var(value))
    u = np.concatenate([np.interp(seen.t, *recording.speed) for seen, recording, _ in pairs])
    return {
        "source": pairs[0][1].yaw_rate_source,
        "samples": len(value),
        "recorded_rms": _rms(value),
        "bias": float(off.mean()),
        "steer_error": atan(wheelbase * float(off @ u) / float(u @ u)),
        "rms": _rms(off),
        "rms_without_bias": float(np.std(off)),
        "kinematic_rms_without_bias": float(np.std(np.concatenate(slipless))) if slipless else None,
        "explained": 1.0 - float(np.var(off)) / spread if spread > 0 else None,
        "gain": float(np.cov(model, value)[0, 1] / np.var(model, ddof=1)) if np.var(model) > 0 else None,
        "lag_s": _lag([(seen, driven) for seen, _, driven in pairs]),
    }


def moving(recording: FieldRecording, series: TimeSeries) -> TimeSeries:
    """Return the samples of a series at times when the tractor moves faster than `LEAST_SPEED`."""
    fast = np.abs(np.interp(series.t, *recording.speed)) > LEAST_SPEED
    return TimeSeries(series.t[fast], series.value[fast])


def _lag(pairs: Sequence[tuple[TimeSeries, Driven]]) -> float:
    """Return the lag of the recorded yaw rate behind the yaw rate of the plant [s], by least squares."""
    lags = np.arange(-LARGEST_LAG_S, LARGEST_LAG_S + 1e-9, 0.02)
    off = [[np.interp(seen.t - lag, driven.t, driven.yaw_rate) - seen.value for seen, driven in pairs] for lag in lags]
    spread = np.array([np.var(np.concatenate(each)) for each in off])
    k = int(np.clip(spread.argmin(), 1, len(lags) - 2))
    before, here, after = spread[k - 1 : k + 2]
    bend = before - 2 * here + after
    return float(lags[k] + (0.5 * 0.02 * (before - after) / bend if bend > 0 else 0.0))


def position_errors(recording: FieldRecording, driven: Driven) -> tuple[Array, Array, Array]:
    """Return times (n,) [s], position errors ahead and to the left (n, 2) [m], and window errors (n,) [m].

    Errors are plant minus recording, in the axes of the plant. Window errors are distances after the best rigid
    alignment of each window, or NaN in a window with too few positions.
    """
    fixes, model = beside(recording, driven)
    east, north = (model - fixes.value).T
    yaw = np.interp(fixes.t, driven.t, driven.yaw)
    c, s = np.cos(yaw), np.sin(yaw)
    shape = np.full(len(fixes.t), nan)
    for _, inside, laid in windows(fixes, model, driven.t[0]):
        shape[inside] = np.hypot(*(laid - fixes.value[inside]).T)
    return fixes.t, np.column_stack([c * east + s * north, -s * east + c * north]), shape


def beside(recording: FieldRecording, driven: Driven) -> tuple[TimeSeries, Array]:
    """Return recorded positions, and plant positions at the same times (n, 2) [m]. Both may be empty."""
    if recording.position is None:
        return TimeSeries(np.empty(0), np.empty((0, 2))), np.empty((0, 2))
    fixes = recording.position.between(driven.t[0], driven.t[-1])
    return fixes, np.column_stack([np.interp(fixes.t, driven.t, each) for each in driven.point.T])


def windows(fixes: TimeSeries, model: Array, start: float) -> Iterator[tuple[int, Array, Array]]:
    """Yield the number of each window, the mask (n,) of the recorded positions in the window, and the plant positions
    after alignment with them [m]."""
    window = ((fixes.t - start) // WINDOW_S).astype(int)
    for k in np.unique(window):
        inside = window == k
        if inside.sum() >= 8 and np.ptp(fixes.t[inside]) > 0.5 * WINDOW_S:
            yield int(k), inside, rigid(model[inside], fixes.value[inside]).of(model[inside])


def _stretch(pieces: Sequence[Replayed]) -> float:
    """Return the ratio of the recorded track length to the track length of the plant [-], or NaN without positions."""
    recorded = own = 0.0
    for recording, driven in pieces:
        fixes, model = beside(recording, driven)
        if len(fixes.t):
            recorded += float(chords(fixes, STRETCH_S)[1].sum())
            own += float(chords(TimeSeries(fixes.t, model), STRETCH_S)[1].sum())
    return recorded / own if own else nan


def _position(pieces: Sequence[Replayed]) -> dict[str, Any] | None:
    errors = [each for each in (position_errors(*piece) for piece in pieces) if len(each[0]) >= 4]
    if not errors:
        return None
    off, shape = np.concatenate([each[1] for each in errors]), np.concatenate([each[2] for each in errors])
    distance, fitted = np.hypot(*off.T), shape[np.isfinite(shape)]
    return {
        "samples": len(off),
        "ahead_rms": _rms(off[:, 0]),
        "left_rms": _rms(off[:, 1]),
        "rms": _rms(distance),
        "largest": float(distance.max()),
        "at_the_end": float(np.mean([np.hypot(*each[1][-1]) for each in errors])),
        "window_s": WINDOW_S,
        "stretch": stretch if isfinite(stretch := _stretch(pieces)) else None,
        "windows_rms": _rms(fitted) if len(fitted) else None,
        "windows_p95": float(np.percentile(fitted, 95)) if len(fitted) else None,
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
