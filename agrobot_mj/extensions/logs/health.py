"""Properties of a log computed without a vehicle fit: position noise, recording bursts, steering centre, antenna
position.

The computation requires neither segments of several seconds nor known machine parameters. The steering centre follows
from a regression without slip, which does not require the wheelbase. If the centre changes or differs from the map, the
sensor has probably slipped.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import degrees, sqrt
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.table_columns import FieldLogError, Source
from agrobot_mj.extensions.logs.direction import LONGEST_STEP_S, with_direction
from agrobot_mj.extensions.logs.identify.windows import FIT_S
from agrobot_mj.extensions.logs.maps import LogMap, SteerColumn
from agrobot_mj.extensions.logs.pieces import SHORTEST_S, Bursts, bursts
from agrobot_mj.extensions.logs.recording import FieldRecording, read_recording
from agrobot_mj.extensions.logs.replay.residuals import moving
from agrobot_mj.extensions.logs.series import scatter
from agrobot_mj.extensions.logs.steering import (
    LEAST_SAMPLES,
    SIGMAS,
    RoughSteering,
    SteeringCentre,
    centre_of,
    centres_differ,
    line_of,
    most_linear,
    standard_error,
    turning,
    two_sided,
)

WHEELBASE_M = 2.0  # Wheelbase in the first regression [m]. Assumed value, which only affects the scale of small angles.
WHEELBASES = (0.5, 0.7, 1.0, 1.4, 2.0)
"""Wheelbases in the second regression, divided by `WHEELBASE_M` [-]. In tight bends, a wrong wheelbase makes the
relation between sensor value and wheel angle nonlinear, which shifts the centre of sections with bends in one
direction."""
PART_S, MOST_PARTS = 15.0, 6
"""Minimum driving time [s] of a log section with a separate steering centre, and maximum number of these sections."""
TOLD = 0.5
"""Minimum fraction of the yaw-rate variance that the steering must explain for a valid centre [-]. Assumed value."""
CHORD_S, MOST_ALIKE = 0.5, 20.0
"""Minimum time between fixes [s] and maximum condition number [-] in the regression of the antenna position."""
ARM_M, ARM_ERROR_M = 0.3, 0.3
"""Minimum error of the antenna position in the column map that is reported, in addition to `SIGMAS` standard errors
[m]. Maximum standard error of a valid estimate of this position [m]."""


class CentrePart(NamedTuple):
    """Steering centre in a section of a log, from time `start` to time `end` [s]."""

    start: float
    end: float
    centre: SteeringCentre


class LogHealth(NamedTuple):
    """Properties of a log computed without a vehicle fit. Unidentified properties are None."""

    name: str
    scatter_m: float | None  # Standard deviation of white noise in each coordinate of the positions [m]
    bursts: Bursts | None
    steering: RoughSteering | None
    parts: tuple[CentrePart, ...]  # Steering centre in each part of the log, in order of time
    ahead_m: tuple[float, float] | None
    """Distance of the antenna ahead of the rear axle and its standard error [m], or None if not identified."""

    @property
    def centre(self) -> SteeringCentre:
        """Mean steering centre over the sections of the log. The standard error follows from the scatter between the
        sections."""
        first, *others = (part.centre for part in self.parts)
        if not others:
            return first
        values = [each.value for each in (first, *others)]
        return SteeringCentre(float(np.mean(values)), standard_error(values))


def health(recording: FieldRecording) -> LogHealth:
    """Return the properties of a recording in which the wheel angles are raw sensor values."""
    whole = with_direction(recording).recording
    steering, parts = _steering(whole)
    noise = None if whole.position is None else scatter(whole.position.value)
    return LogHealth(whole.name, noise, bursts(whole), steering, parts, _ahead(whole))


def _steering(recording: FieldRecording) -> tuple[RoughSteering | None, tuple[CentrePart, ...]]:
    """Return the relation between sensor value and wheel angle without slip, and the steering centres in sections of
    the log with equal numbers of samples. Without sufficient samples, return None and an empty tuple."""
    if recording.steer is None or recording.yaw_rate is None:
        return None, ()
    found = turning([recording], WHEELBASE_M)
    if found is None or len(found.angle) < LEAST_SAMPLES:
        return None, ()
    ratio = most_linear(found, line_of(found), WHEELBASES)
    found, wheelbase = found.with_wheelbase(ratio), ratio * WHEELBASE_M
    rough = two_sided(found, line_of(found))
    seen = moving(recording, recording.yaw_rate)
    number = min(MOST_PARTS, int(len(seen.t) * np.median(np.diff(seen.t)) / PART_S))
    borders = [int(each) for each in np.linspace(0, len(seen.t) - 1, max(number, 1) + 1)]
    parts = []
    for start, end in pairwise(float(seen.t[k]) for k in borders):
        part = recording._replace(yaw_rate=recording.yaw_rate.between(start, end))
        if (centre := centre_of([part], wheelbase, rough)) is not None:
            parts.append(CentrePart(start, end, centre))
    return rough, tuple(parts)


def _ahead(recording: FieldRecording) -> tuple[float, float] | None:
    """Return the distance of the antenna ahead of the rear axle and its standard error [m], or None if not identified.

    The lateral velocity of the antenna is the yaw rate times this distance, plus the speed times the mounting angle of
    the heading sensor, plus the product of speed and yaw rate times the latency of the heading sensor.
    """
    if recording.position is None or recording.heading is None:
        return None
    t, places = recording.position
    every = max(1, round(CHORD_S / float(np.median(np.diff(t)))))
    t, z = t[::every], (places @ (1, 1j))[::every]
    yaw, dt = recording.heading.at(t), np.diff(t)
    middle = (yaw[1:] + yaw[:-1]) / 2
    rate, u = np.diff(yaw) / dt, np.interp((t[1:] + t[:-1]) / 2, *recording.speed)
    side = (np.diff(z) / dt * np.exp(-1j * middle)).imag
    kept = (dt < LONGEST_STEP_S) & (np.abs(rate) < 1.0)
    if kept.sum() < LEAST_SAMPLES:
        return None
    columns = np.column_stack([rate, u, u * rate])[kept]
    size = np.sqrt((columns**2).mean(axis=0))
    if not size.all() or np.linalg.cond(columns / size) > MOST_ALIKE:
        return None
    values = np.linalg.lstsq(columns, side[kept])[0]
    off = side[kept] - columns @ values
    error = sqrt(float(off @ off) / len(off) * np.linalg.inv(columns.T @ columns)[0, 0])
    return (float(values[0]), error) if error < ARM_ERROR_M else None


def health_lines(sources: Sequence[Source], log_map: LogMap) -> list[str]:
    """Return sentences about steering centre, antenna position, noise and bursts of logs. Skip unreadable logs."""
    found = []
    for source in sources:
        try:
            found.append(health(read_recording(source, log_map, 0.0, readings=True)))
        except FieldLogError:
            continue
    lines = [f"{each.name}: {line}" for each in found for line in sentences_of(each, log_map)]
    judged = [each for each in found if each.steering and each.parts and each.steering.explained >= TOLD]
    return [*lines, *(line for one, other in pairwise(judged) for line in _moved_centres(one, other))]


def _moved_centres(one: LogHealth, other: LogHealth) -> Iterator[str]:
    """Yield a sentence if the steering centres of two consecutive logs differ significantly."""
    assert one.steering is not None
    if centres_differ((one.centre, other.centre), one.steering):
        digits = _digits(one.steering)
        before, after = (f"{each.centre.value:.{digits}f} in {each.name}" for each in (one, other))
        yield f"the steering centre is {before} and {after}: the sensor has moved; evaluate each log separately"


def _digits(rough: RoughSteering) -> int:
    """Return the number of decimals needed to show a steering centre with a resolution of 0.1 deg."""
    return max(0, -int(np.floor(np.log10(0.1 / degrees(abs(rough.scale))))))


def sentences_of(h: LogHealth, m: LogMap) -> Iterator[str]:
    """Yield sentences that describe the properties `h` of a log, including differences from its column map `m`."""
    if h.bursts:
        yield (
            f"recorded in {h.bursts.number} bursts of {h.bursts.length:.1f} s, one every {h.bursts.period:.1f} s; a "
            f"replay needs bursts of at least {SHORTEST_S:g} s, a fit of {FIT_S:g} s"
        )
    if h.scatter_m is not None:
        yield f"the positions scatter by {100 * h.scatter_m:.2g} cm from fix to fix"
    if h.steering is not None and h.parts and m.steer is not None:
        yield from _of_steering(h, h.steering, m.steer)
    if h.ahead_m is not None and m.position is not None:
        ahead, error = h.ahead_m
        if abs(ahead - m.position.ahead_m) > ARM_M + SIGMAS * error:
            yield (
                f"the antenna is about {ahead:.1f} m ahead of the rear axle, but the map has {m.position.ahead_m:g} "
                "(position.ahead_m)"
            )


def _of_steering(h: LogHealth, steering: RoughSteering, m: SteerColumn) -> Iterator[str]:
    share = 100 * max(steering.explained, 0.0)
    if steering.explained < TOLD:
        yield f"the steering explains {share:.0f} % of the yaw rate, too little to evaluate the steering centre"
        return
    digits, centres = _digits(steering), [part.centre for part in h.parts]
    where = ", ".join(f"{each.centre.value:.{digits}f} ({each.start:.0f}-{each.end:.0f} s)" for each in h.parts)
    yield f"the steering explains {share:.0f} % of the yaw rate; steering centre: {where}"
    if centres_differ(centres, steering):
        apart = max(centres).value - min(centres).value
        yield f"the steering centre moves by {apart:.{digits}f} within this log; check whether the sensor is loose"
    elif (
        m.unit != "1/m"
        and "offset" in m.model_fields_set
        and centres_differ((h.centre, SteeringCentre(m.offset, 0.0)), steering)
    ):
        yield (
            f"the steering centre in this log is {h.centre.value:.{digits}f}, but the map has {m.offset:g}: the sensor "
            "has moved, or the map belongs to another sensor (steer.offset)"
        )
