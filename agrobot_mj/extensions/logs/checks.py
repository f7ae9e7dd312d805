"""Checks of the columns of a log for low rates, coarse resolution, and contradictory units and signs."""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.series import chords, course_rate, slope_of

CHORD_S, SLIPPED = 2.0, 1.5
"""Time interval over which track lengths are computed [s], and maximum ratio between the track lengths from positions
and from speed [-]. Assumed values."""
LONGEST_ARM_M, ARM_EXPLAINS = 6.0, 0.2
"""Limits for explaining a wrong track length by the position of the antenna: maximum distance from antenna to rear axle
[m], and maximum relative RMS residual [-]. Assumed values."""
AGREED = 0.5
"""Minimum correlation between the course rate of the positions and the yaw rate of a sensor for detecting a wrong unit
or sign [-]. Assumed value: consistent sensors reach 0.9."""
OTHER_UNIT = 5.0  # Ratio of two yaw rates above which one rate has a wrong unit [-]; deg/s instead of rad/s gives 57
LEAST_HZ = 2.5  # Minimum sampling rate at which positions and headings resolve yaw dynamics [Hz]
COARSE_M_S = 0.12
"""Resolution of speed above which rounding biases a fitted scale [m/s]. Assumed value: 1 km/h gives a bias of 5 %."""


def check_columns(kept: Sequence[FieldRecording]) -> None:
    """Raise `FieldLogError` for slow, coarse or contradictory columns, for example a speed in a wrong unit."""
    _check_rates(kept)
    _check_speed(kept)
    _check_turning(kept)


def _check_rates(recordings: Sequence[FieldRecording]) -> None:
    """Raise `FieldLogError` if the heading or yaw rate is constant, the resolution of the speed is too low, or the
    positions or headings are too infrequent."""
    name = recordings[0].name
    for part in ("heading", "yaw_rate"):
        values = [series.value for each in recordings if (series := getattr(each, part)) is not None]
        if values and recordings[0].yaw_rate_source != "course" and not np.ptp(np.concatenate(values)):
            raise FieldLogError(f"{name}: [{part}] is constant; specify another column, or remove it from the map")
    readings = np.unique(np.concatenate([each.speed.value for each in recordings]))
    step = float(np.diff(readings).min()) if len(readings) > 1 else 0.0
    if step > COARSE_M_S and np.allclose(readings / step, np.round(readings / step), atol=0.02):
        raise FieldLogError(f"{name}: the resolution of [speed] is {step:.2g} m/s, too low for a fit; log more digits")
    for part in ("heading", "position"):
        steps = [np.diff(series.t) for each in recordings if (series := getattr(each, part)) is not None]
        if steps and (rate := 1.0 / float(np.median(np.concatenate(steps)))) < LEAST_HZ:
            raise FieldLogError(
                f"{name}: the rate of [{part}] is {rate:.2g} Hz, but a fit needs {LEAST_HZ:g} Hz; log every "
                f"value of the receiver, or remove [{part}] from the map if the log has a gyro"
            )


def _check_speed(recordings: Sequence[FieldRecording]) -> None:
    """Raise `FieldLogError` if the track lengths from speed and from positions differ by more than slip can explain."""
    found = [part for piece in recordings if (part := _ways(piece)) is not None]
    if not found:
        return
    way, said, across = np.concatenate(found, axis=1)
    if not said.any() or 1 / SLIPPED < way.sum() / said.sum() < SLIPPED:
        return
    fix = "check the unit of [speed] and the columns of [position] in the map"
    if arm := _arm(way, said, across):
        fix = (
            f"an antenna {arm:.1f} m ahead of or behind the rear axle would explain the difference: set "
            "position.ahead_m to the distance of the antenna"
        )
    raise FieldLogError(
        f"{recordings[0].name}: the positions cover {way.sum():.0f} m, but the speed gives {said.sum():.0f} m; {fix}"
    )


def _ways(piece: FieldRecording) -> Array | None:
    """Return the motion in consecutive intervals of `CHORD_S`, shape (3, n), or None if there are no positions.

    Row 0: distance between positions [m]. Row 1: distance travelled by the antenna, from speed and yaw rate [m]. Row 2:
    change of yaw [rad].
    """
    if piece.position is None or not len(piece.position.t):
        return None
    t, chord = chords(piece.position, CHORD_S)
    middle, (ahead, left, _) = (t[1:] + t[:-1]) / 2, piece.arm
    u = np.interp(middle, *piece.speed)
    rate = np.zeros(len(u)) if piece.yaw_rate is None else np.interp(middle, *piece.yaw_rate)
    return CHORD_S * np.stack([chord / CHORD_S, np.hypot(u - left * rate, ahead * rate), rate])


def _arm(way: Array, said: Array, across: Array) -> float | None:
    """Return the distance of the antenna from the rear axle that would explain the track lengths [m], or None if no
    distance explains them."""
    bend = float((across**4).sum())
    squared = float(((way**2 - said**2) * across**2).sum()) / bend if bend else 0.0
    if not 0.0 < squared < LONGEST_ARM_M**2:
        return None
    off = way - np.sqrt(said**2 + squared * across**2)
    return sqrt(squared) if float((off**2).sum()) < ARM_EXPLAINS**2 * float((way**2).sum()) else None


def _check_turning(recordings: Sequence[FieldRecording]) -> None:
    """Raise `FieldLogError` if the course turns opposite to the gyro or the heading, or at a very different rate."""
    for source, key in (("gyro", "yaw_rate.positive"), ("heading", "heading.convention")):
        pairs = [pair for piece in recordings if (pair := _turning_twice(piece, source)) is not None]
        if not pairs:
            continue
        course, rate = (each - each.mean() for each in np.concatenate(pairs, axis=1))
        common, turned = float((course * rate).sum()), float((rate**2).sum())
        alike = AGREED * sqrt(turned * float((course**2).sum()))
        if common > alike and not 1 / OTHER_UNIT < common / turned < OTHER_UNIT:
            raise FieldLogError(
                f"{recordings[0].name}: the course of the positions turns {common / turned:.2g} times as fast as the "
                f"{source}; check the unit and the column of [{key.partition('.')[0]}] in the map"
            )
        if common < -alike:
            raise FieldLogError(
                f"{recordings[0].name}: the course of the positions turns right where the {source} turns left; check "
                f"whether the east and north columns of [position] are swapped; otherwise change {key} in the map"
            )


def _turning_twice(piece: FieldRecording, source: str) -> Array | None:
    """Return course rate and yaw rate of the `source` (gyro or heading) at common times [rad/s], shape (2, n), or None
    if either is not measured."""
    rate = piece.yaw_rate if piece.yaw_rate_source == source else None
    if source == "heading" and piece.heading is not None:
        rate = slope_of(piece.heading)
    if piece.position is None or rate is None or (course := course_rate(piece.position, piece.speed)) is None:
        return None
    return np.stack([course.value, np.interp(course.t, *rate)])
