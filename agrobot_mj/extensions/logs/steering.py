"""Relation between steering sensor and wheel angle without tyre slip: centre, scale and latency by regression.

The wheel angle without slip, atan(L r / u), is computed from yaw rate r, speed u and wheelbase L. This angle is
regressed on the raw sensor value, with the latency that explains the most variance. A sensor on one wheel or on a
linkage has different scale factors to the left and to the right. If the factors differ significantly, two lines that
meet at the centre are fitted, because one line would shift the centre.
"""

from collections.abc import Sequence
from math import degrees, hypot, inf, radians, sqrt
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.residuals import moving
from agrobot_mj.extensions.logs.series import TimeSeries, scatter

AGES_S = np.arange(-0.5, 1.5, 0.02)  # Evaluated latencies of the yaw rate relative to the steering [s]
LEAST_EXPLAINED = 0.5
"""Minimum fraction of the angle variance that a valid regression explains [-]. Assumed value; working sensors exceed
0.9."""
LEAST_SAMPLES = 50  # Minimum number of yaw-rate samples for a regression
OUTLIER = 3.0  # Distance from the line above which a sample is an outlier [robust standard deviations]
SIDES_DIFFER, SURELY = 0.05, 4.0
"""Criteria for separate scales to the left and right: minimum relative difference, and minimum ratio of the difference
to its standard error [-]. Assumed values: the scale factors of typical linkages differ by more."""
LEAST_SIDE, SIDE_RAD = 0.1, radians(2.0)
"""Criteria for separate scales to the left and right: minimum fraction of samples on each side [-], and minimum wheel
angle of these samples [rad]. Assumed values."""
MORE_LINEAR = 0.8
"""Maximum unexplained variance with the most suitable wheelbase, divided by that with the first wheelbase [-]. Assumed
value."""
BLOCKS = 6  # Number of blocks into which a log is divided for standard errors by the jackknife
CENTRES = 101  # Number of steering centres that each step of a search evaluates
MOVED_DEG, SIGMAS = 1.0, 3.0
"""Minimum reported difference between steering centres: constant [deg], plus a number of standard errors [-]."""


class RoughSteering(NamedTuple):
    """Relation between raw sensor value and wheel angle: one line, or two lines that meet at the centre."""

    centre: float  # Sensor value with the wheels straight ahead [unit of the sensor]
    scale: float
    """Wheel angle per sensor unit when steering left [rad/unit], negative if sensor values increase to the right."""
    age: float  # Latency of the yaw rate relative to the steering [s]
    explained: float  # Fraction of the variance of the wheel angle that the relation explains [-]
    right: float = 1.0  # Scale to the right divided by the scale to the left [-], or 1 for one line

    def wheel(self, reading: Array) -> Array:
        """Return the wheel angle [rad] for raw sensor values."""
        angle = self.scale * (reading - self.centre)
        return np.where(angle < 0, self.right * angle, angle)

    def less_wheel(self, reading: Array, angle: Array) -> Array:
        """Return the raw sensor values minus the effect of known wheel angles `angle` [rad]. Without errors, the result
        is the steering centre [unit of the sensor]."""
        return reading - np.where(angle < 0, angle / self.right, angle) / self.scale

    def angle(self, recording: FieldRecording) -> FieldRecording:
        """Return the recording with wheel angles instead of raw values. The left scale applies to both sides."""
        assert recording.steer is not None
        t, reading = recording.steer
        return recording._replace(steer=TimeSeries(t, self.scale * (reading - self.centre)))


class SteeringCentre(NamedTuple):
    """Steering centre in a section of a log."""

    value: float  # Sensor value with the wheels straight ahead [unit of the sensor]
    error: float  # Standard error of the value, from the scatter between blocks of samples [unit of the sensor]


class TurningSamples(NamedTuple):
    """Samples for the regression: raw sensor values, and wheel angles without slip from the yaw rate."""

    reading: Array  # Raw sensor values for each latency in `AGES_S`, shape (latencies, n) [unit of the sensor]
    angle: Array  # Wheel angle that gives the measured yaw rate without slip [rad], shape (n,)
    weight: Array  # Weights of the samples, shape (n,)

    def reading_at(self, age: float) -> Array:
        """Return the raw sensor values for the latency in `AGES_S` that is nearest to `age` [s], shape (n,)."""
        found: Array = self.reading[int(np.abs(AGES_S - age).argmin())]
        return found

    def with_wheelbase(self, ratio: float) -> "TurningSamples":
        """Return the samples for a wheelbase that is multiplied by `ratio`."""
        angle = np.arctan(ratio * np.tan(self.angle))
        return self._replace(angle=angle, weight=self.weight * np.square(np.cos(angle) / np.cos(self.angle)))


def rough_steering(pieces: Sequence[FieldRecording], wheelbase: float) -> RoughSteering:
    """Fit the wheel angle without slip as a function of the raw sensor value. Raises `FieldLogError` for a poor fit."""
    found, name = turning(pieces, wheelbase), pieces[0].name
    if found is None or len(found.angle) < LEAST_SAMPLES:
        seconds, count = sum(each.end - each.start for each in pieces), 0 if found is None else len(found.angle)
        raise FieldLogError(
            f"{name}: {seconds:.0f} s of the log are usable, with {count} values of yaw rate, heading or position in "
            f"motion, but a fit needs {LEAST_SAMPLES}; add a column to the map, or use a longer log"
        )
    best = line_of(found)
    if best.explained < LEAST_EXPLAINED:
        share, noisy = 100 * max(best.explained, 0.0), ""
        if pieces[0].yaw_rate_source == "course" and pieces[0].position is not None:
            noise = 100 * scatter(pieces[0].position.value)
            noisy = f", or add a heading or a gyro, because the positions scatter by {noise:.2g} cm"
        raise FieldLogError(
            f"{name}: a straight-line fit to the steering measurements explains {share:.0f} % of the yaw rate; check "
            f"that [steer] is the wheel angle and that the log has bends in both directions{noisy}"
        )
    return two_sided(found, best)


def turning(pieces: Sequence[FieldRecording], wheelbase: float) -> TurningSamples | None:
    """Return the regression samples of all segments, or None if no segment has a yaw rate in motion."""
    found = [part for part in (_turning(piece, wheelbase) for piece in pieces) if part is not None]
    return TurningSamples(*(np.concatenate(each, axis=-1) for each in zip(*found, strict=True))) if found else None


def _turning(piece: FieldRecording, wheelbase: float) -> TurningSamples | None:
    assert piece.steer is not None
    if piece.yaw_rate is None or len((seen := moving(piece, piece.yaw_rate)).t) < 2:
        return None
    u = np.interp(seen.t, *piece.speed)
    read = np.array([np.interp(seen.t - age, *piece.steer) for age in AGES_S])
    angle = np.arctan(wheelbase * seen.value / u)
    return TurningSamples(
        read, angle, np.abs(u) * np.cos(angle) ** 2
    )  # noise of the angle = noise of the yaw rate / weight


def line_of(found: TurningSamples) -> RoughSteering:
    """Return the regression line of wheel angle over sensor value, for the latency that explains the most variance."""
    lines = (_line(reading, found.angle, found.weight) for reading in found.reading)
    (explained, scale, centre), age = max(zip(lines, map(float, AGES_S), strict=True))
    return RoughSteering(centre, scale, age, explained)


def _line(reading: Array, angle: Array, weight: Array) -> tuple[float, float, float]:
    """Return the explained fraction of variance, the slope, and the sensor value at angle zero of a regression line.
    The fit is repeated once without outliers."""
    kept = np.ones(len(angle), dtype=bool)
    for _ in range(2):
        if np.ptp(reading[kept]) == 0.0 or np.ptp(angle[kept]) == 0.0:
            return 0.0, 1.0, 0.0
        slope, level = np.polyfit(reading[kept], angle[kept], 1, w=weight[kept])
        off = weight * (angle - slope * reading - level)
        kept = np.abs(off) < OUTLIER * 1.4826 * np.median(np.abs(off)) + 1e-12
    return _explained_fraction(off, angle, weight), float(slope), float(-level / slope)


def most_linear(found: TurningSamples, line: RoughSteering, ratios: Sequence[float]) -> float:
    """Return the factor of the wheelbase, from `ratios`, with which a line at the latency of `line` explains the most
    variance of the wheel angle. Return 1 if the unexplained variance hardly depends on the wheelbase."""
    reading = found.reading_at(line.age)
    tried = ((found.with_wheelbase(ratio), ratio) for ratio in ratios)
    explained, ratio = max((_line(reading, each.angle, each.weight)[0], ratio) for each, ratio in tried)
    return ratio if 1.0 - explained < MORE_LINEAR * (1.0 - line.explained) else 1.0


def two_sided(found: TurningSamples, line: RoughSteering) -> RoughSteering:
    """Return two lines that meet at the centre if the left and right scales differ significantly, otherwise `line`.

    A centre that moves during the log also resembles two scales. Therefore the two lines must explain more than one
    scale with a separate centre in each block."""
    if min(np.mean(side * found.angle > SIDE_RAD) for side in (1, -1)) < LEAST_SIDE:
        return line
    samples = np.stack([found.reading_at(line.age), found.angle, found.weight])
    whole = _meeting(samples, line)
    block = np.arange(samples.shape[1]) * BLOCKS // samples.shape[1]
    parts = [_meeting(samples[:, block != k], line) for k in range(BLOCKS)]
    error = sqrt((BLOCKS - 1) * float(np.var([part.right for part in parts])))
    differ = abs(np.log(max(whole.right, 1e-3))) > max(SIDES_DIFFER, SURELY * error / whole.right)
    return whole if differ and whole.explained > _explained_by_blocks(samples, block) else line


def _explained_by_blocks(samples: Array, block: Array) -> float:
    """Return the fraction of variance that one scale with a separate centre in each `block` explains."""
    _, angle, weight = samples
    terms = weight * np.vstack([samples[0], block == np.arange(BLOCKS)[:, None]])
    off = weight * angle - np.linalg.lstsq(terms.T, weight * angle)[0] @ terms
    return _explained_fraction(off, angle, weight)


def _explained_fraction(off: Array, angle: Array, weight: Array) -> float:
    """Return the fraction of the variance of `angle` that a fit with the weighted residuals `off` explains [-]."""
    spread = weight * (angle - np.average(angle, weights=weight**2))
    return 1.0 - float((off**2).sum() / (spread**2).sum())


def _meeting(samples: Array, line: RoughSteering) -> RoughSteering:
    """Return two lines that meet at angle zero, fitted to `samples` (3, n): sensor value, angle and weight."""
    reading, angle, weight = samples
    kept, centre = np.ones(len(reading), dtype=bool), line.centre
    reach = 0.25 * float(np.ptp(reading))
    found = line
    for _ in range(2):
        low, high = centre - reach, centre + reach
        for _ in range(3):  # each search is fifty times finer than the one before
            tried = np.linspace(low, high, CENTRES)
            fits = [_slopes(samples[:, kept], each, line.scale) for each in tried]
            k = int(np.argmin([fit[0] for fit in fits]))
            low, high = tried[max(k - 1, 0)], tried[min(k + 1, CENTRES - 1)]
        centre, (_, left, right) = float(tried[k]), fits[k]
        found = line._replace(centre=centre, scale=left, right=right / left if left else 1.0)
        off = weight * (angle - found.wheel(reading))
        kept = np.abs(off) < OUTLIER * 1.4826 * np.median(np.abs(off)) + 1e-12
    return found._replace(explained=_explained_fraction(off, angle, weight))


def _slopes(samples: Array, centre: float, scale: float) -> tuple[float, float, float]:
    """Return squared error and slopes (left, right) of two lines that meet at angle zero and sensor value `centre`."""
    reading, angle, weight = samples
    x, wy, left = weight * (reading - centre), weight * angle, (reading - centre) * scale > 0
    total, slopes = 0.0, []
    for side in (left, ~left):
        square, product = float(x[side] @ x[side]), float(x[side] @ wy[side])
        slopes.append(product / square if square else scale)
        total += float(wy[side] @ wy[side]) - (product**2 / square if square else 0.0)
    return total, slopes[0], slopes[1]


def centre_of(kept: Sequence[FieldRecording], wheelbase: float, rough: RoughSteering) -> SteeringCentre | None:
    """Return the mean steering centre for `rough` with its standard error, or None without samples in motion."""
    if (found := turning(kept, wheelbase)) is None:
        return None
    read = found.reading_at(rough.age)
    centre, weight = rough.less_wheel(read, found.angle), found.weight**2
    split = (np.array_split(each, min(BLOCKS, len(centre))) for each in (centre, weight))
    blocks = [np.average(values, weights=weights) for values, weights in zip(*split, strict=True)]
    return SteeringCentre(float(np.average(centre, weights=weight)), standard_error(blocks))


def standard_error(values: Sequence[float]) -> float:
    """Return the standard error of the mean of independent values, or infinity for one value."""
    return float(np.std(values, ddof=1)) / sqrt(len(values)) if len(values) > 1 else inf


def centres_differ(centres: Sequence[SteeringCentre], rough: RoughSteering) -> bool:
    """Return whether the lowest and the highest of several steering centres differ significantly."""
    if len(centres) < 2:
        return False
    low, high = min(centres), max(centres)
    apart = high.value - low.value - SIGMAS * hypot(low.error, high.error)
    return degrees(abs(rough.scale)) * apart > MOVED_DEG
