"""Direction of travel, for recorded speeds without a sign, such as the speed of a GNSS receiver.

Displacements between fixes, projected on the heading, are summed to a forward distance. Where this distance decreases
by more than the noise, the tractor has reversed. The change of direction is at the nearest minimum speed. A heading
with an angular offset (two antennas across the machine) is first rotated by its mean angle to the course, because
machines mostly drive forwards. Without a heading, the course is used, which jumps by 180 deg where the tractor changes
its direction. Noise of positions without RTK resembles such jumps. Therefore the steering also determines the
direction: the yaw rate divided by the speed is linear in the wheel angle, and has the opposite sign in reverse.
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import find_peaks

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.series import TimeSeries, scatter

SIGNED = -0.1  # Recorded speeds below this limit indicate a signed speed [m/s]. Assumed value: below the noise at rest.
LEAST_LEG_M, LEG_PER_SCATTER = 0.5, 10.0
"""Minimum length of a section between direction changes: a constant [m] or, if longer, a multiple of the noise [-]."""
AROUND_S = 2.0  # Time before and after a change of direction in which the minimum speed is searched [s]
LONGEST_STEP_S = 2.0  # Maximum time between two fixes whose displacement is used [s]
STANDING_M_S = 0.1
"""Speed below which a machine is at rest [m/s]. Assumed value: three times the speed noise of a receiver at rest."""
LEAST_TOLD, LEAST_GAIN = 0.3, 0.01
"""Limits for the fraction of the yaw-rate variance that the steering explains [-]: minimum for determining directions,
and minimum increase for reversing the direction of a section. Assumed values: above the effect of noise."""
MOST_TURN = 3.0
"""Maximum valid yaw rate, divided by the 80 % quantile of all absolute yaw rates [-]. Assumed value."""
MOST_LEGS = 200  # Maximum number of sections between direction changes for which the steering determines the directions


class Directed(NamedTuple):
    """Recording with a signed speed, negative in reverse."""

    recording: FieldRecording
    reverse_m: float  # Distance that the detection attributes to reverse [m], or 0 if the recorded speed is signed
    mounting: float | None  # Mean angle from the course to the recorded heading [rad], or None if not identified
    how: str = ""  # Quantity from which reverse was detected, or an empty string if no reverse is detected


def is_signed(recording: FieldRecording) -> bool:
    """Return whether the recorded speed is negative in reverse, according to the column map or to its values."""
    return recording.signed or float(recording.speed.value.min()) < SIGNED


def with_direction(recording: FieldRecording) -> Directed:
    """Return the recording with a negative speed in reverse, or unchanged if the direction is not identified."""
    speed = recording.speed
    if recording.position is None or len(recording.position.t) < 8:
        return Directed(recording, 0.0, None)
    least = max(LEAST_LEG_M, LEG_PER_SCATTER * scatter(recording.position.value))
    t, step = _displacements(recording.position)
    step[np.abs(np.interp(t, *speed)) < STANDING_M_S] = 0.0
    how, mounting = "heading", None
    if recording.heading is not None:
        along = step * np.exp(-1j * recording.heading.at(t))
        mounting = -float(np.angle(along.sum()))
        forward = (along * np.exp(1j * mounting)).real
    else:
        forward, how = by_course(step, least), "changes of the course"
    if is_signed(recording):
        return Directed(recording, 0.0, mounting)
    borders, signs = _legs(t, forward, speed, least)
    if recording.heading is None and signs.min() < 0 and (told := _by_steering(recording, borders, signs)) is not None:
        signs, how = told, "changes of the course and the steering"
    if signs.min() > 0:
        return Directed(recording, 0.0, mounting)
    value = signs[np.searchsorted(borders, speed.t, side="right")] * np.abs(speed.value)
    back = float(np.sum(np.maximum(-value[:-1], 0.0) * np.diff(speed.t)))
    return Directed(recording._replace(speed=TimeSeries(speed.t, value)), back, mounting, how)


def _displacements(position: TimeSeries) -> tuple[Array, Array]:
    """Return the mean times of consecutive fixes [s], and the displacements between these fixes as complex numbers,
    east + i north [m]. Displacements across gaps are zero."""
    step = np.diff(position.value[:, 0] + 1j * position.value[:, 1])
    step[np.diff(position.t) > LONGEST_STEP_S] = 0.0
    return (position.t[:-1] + position.t[1:]) / 2, step


def by_course(step: Array, least: float) -> Array:
    """Return the distances between fixes, negative in reverse [m], from displacements `step` as complex numbers east +
    i north [m]. The direction changes where the course reverses between two sections of length `least` [m]."""
    sign, now, start, leg, before = np.ones(len(step)), 1.0, 0, 0j, 0j
    for k in range(len(step)):
        leg += step[k]
        if abs(leg) < least:
            continue
        if before and (leg * before.conjugate()).real < 0:
            now = -now
        sign[start : k + 1] = now
        before, leg, start = leg, 0j, k + 1
    sign[start:] = now
    forward: Array = sign * np.abs(step)
    return forward if forward.sum() >= 0 else -forward


def _legs(t: Array, forward: Array, speed: TimeSeries, least: float) -> tuple[Array, Array]:
    """Return the times of direction changes (n,) [s], and the direction of each section (1 or -1), shape (n + 1,)."""
    way = np.cumsum(forward)
    turns = sorted(k for up in (way, -way) for k in find_peaks(up, prominence=least)[0])
    borders = np.array([_slowest(speed, t[k]) for k in turns])
    return borders, np.where(np.diff(way[[0, *turns, -1]]) < 0, -1.0, 1.0)


def _slowest(speed: TimeSeries, t: float) -> float:
    """Return the time of the minimum absolute speed near time `t` [s]."""
    near = np.abs(speed.t - t) < AROUND_S
    return float(speed.t[near][np.abs(speed.value[near]).argmin()]) if near.any() else t


def _by_steering(recording: FieldRecording, borders: Array, signs: Array) -> Array | None:
    """Return the direction (1 or -1) of each section that best explains the yaw rate, or None if the fit is poor. Most
    of the distance is assumed to be forwards. Centre, scale and sign of the steering sensor may be unknown."""
    if recording.steer is None or recording.yaw_rate is None or len(signs) > MOST_LEGS:
        return None
    t, rate = recording.yaw_rate
    usual = np.abs(rate) <= MOST_TURN * np.quantile(np.abs(rate), 0.8)  # the course jumps where positions jump
    t, rate = t[usual], rate[usual]
    u = np.abs(np.interp(t, *recording.speed))
    leg = np.searchsorted(borders, t, side="right")
    steering = np.column_stack([u * np.interp(t, *recording.steer), u])
    spread = float((rate**2).sum())
    if not spread or not np.ptp(steering[:, 0]):
        return None

    def explained(s: Array) -> float:
        columns = s[leg, np.newaxis] * steering
        return 1.0 - float(((rate - columns @ np.linalg.lstsq(columns, rate)[0]) ** 2).sum()) / spread

    best = max((np.ones(len(signs)), signs), key=explained)
    told = explained(best)
    for k in range(len(signs)):
        other = best.copy()
        other[k] *= -1
        if (more := explained(other)) > told + LEAST_GAIN:
            best, told = other, more
    if told < LEAST_TOLD:
        return None
    way = np.bincount(leg, u * np.gradient(t), len(signs))
    return best if float(best @ way) >= 0 else -best
