"""Direction of travel of a recording whose speed has no sign, as that of a GNSS receiver.

The displacements between fixes, projected on the heading, add up to the way forward; where that way turns back by more
than the noise, the tractor has changed direction, at the least speed nearby. A heading that points elsewhere (two
antennas across the machine) is turned by the mean angle to the course first, since machines drive forward mostly.
Without a heading the course stands for it, which turns over where the tractor changes direction.
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import find_peaks

from agrobot_mj.core.signals import Array
from agrobot_mj.fieldlogs.recording import FieldRecording, TimeSeries

SIGNED = -0.1
"""Speed below which a recorded speed has a sign [m/s]. Estimate: beyond the noise of a standing receiver."""
LEAST_LEG_M = 0.5
"""Way backward that counts as a leg in reverse [m]: ten times the noise of RTK."""
AROUND_S = 2.0
"""Time about a turning point in which the least speed is looked for [s]."""
LONGEST_STEP_S = 2.0
"""Time between two fixes beyond which their displacement counts for nothing [s]."""


class Directed(NamedTuple):
    """A recording with the sign of its speed."""

    recording: FieldRecording
    reverse_m: float
    """Way in reverse that was found; 0 where the speed had its sign [m]."""
    mounting: float | None
    """Mean angle of the recorded heading from the course [rad]; None where nothing tells."""


def directed(recording: FieldRecording) -> Directed:
    """The recording, its speed negative in reverse. As it is where nothing tells the direction."""
    speed = recording.speed
    if recording.position is None or len(recording.position.t) < 8:
        return Directed(recording, 0.0, None)
    t, step = _displacements(recording.position)
    if recording.heading is not None:
        along = step * np.exp(-1j * recording.heading.at(t))
        mounting = -float(np.angle(along.sum()))
        forward = (along * np.exp(1j * mounting)).real
    else:
        forward, mounting = _by_course(step), None
    if speed.value.min() < SIGNED or (sign := _signs(t, forward, speed)) is None:
        return Directed(recording, 0.0, mounting)
    value = sign * np.abs(speed.value)
    back = float(np.sum(np.maximum(-value[:-1], 0.0) * np.diff(speed.t)))
    return Directed(recording._replace(speed=TimeSeries(speed.t, value)), back, mounting)


def _displacements(position: TimeSeries) -> tuple[Array, Array]:
    """Middle times and displacements between fixes, complex east + i north [s, m]; none across a gap."""
    step = np.diff(position.value[:, 0] + 1j * position.value[:, 1])
    step[np.diff(position.t) > LONGEST_STEP_S] = 0.0
    return (position.t[:-1] + position.t[1:]) / 2, step


def _by_course(step: Array) -> Array:
    """Displacements with a sign that changes wherever the course turns over between legs of `LEAST_LEG_M`."""
    sign, now, start, leg, before = np.ones(len(step)), 1.0, 0, 0j, 0j
    for k in range(len(step)):
        leg += step[k]
        if abs(leg) < LEAST_LEG_M:
            continue
        if before and (leg * before.conjugate()).real < 0:
            now = -now
        sign[start : k + 1] = now
        before, leg, start = leg, 0j, k + 1
    sign[start:] = now
    forward: Array = sign * np.abs(step)
    return forward if forward.sum() >= 0 else -forward


def _signs(t: Array, forward: Array, speed: TimeSeries) -> Array | None:
    """Sign of the speed at its times; None where it is forward all along."""
    way = np.cumsum(forward)
    turns = sorted(k for up in (way, -way) for k in find_peaks(up, prominence=LEAST_LEG_M)[0])
    signs = np.where(np.diff(way[[0, *turns, -1]]) < 0, -1.0, 1.0)
    if signs.min() > 0:
        return None
    found: Array = signs[np.searchsorted([_slowest(speed, t[k]) for k in turns], speed.t, side="right")]
    return found


def _slowest(speed: TimeSeries, t: float) -> float:
    """Time of the least speed about `t` [s]."""
    near = np.abs(speed.t - t) < AROUND_S
    return float(speed.t[near][np.abs(speed.value[near]).argmin()]) if near.any() else t
