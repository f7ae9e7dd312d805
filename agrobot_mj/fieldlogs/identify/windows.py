"""Recordings as a fit takes them: pieces with smooth inputs, and windows of what is compared with.

A window has as many samples as every other of its channel and all channels of the log, at speed all the time.
"""

from collections.abc import Callable, Sequence
from functools import cache
from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

from agrobot_mj.core.signals import Array
from agrobot_mj.fieldlogs.identify.model import STEP_S, Chassis2
from agrobot_mj.fieldlogs.recording import FieldRecording, TimeSeries
from agrobot_mj.fieldlogs.replay.residuals import moving

WINDOW_S = 5.0
"""Length of a window [s]: longer than the dynamics, and many in a minute."""
CUT_OFF_HZ = 3.0
"""Cut-off of the low-pass over the inputs [Hz]. Noise above it would pass for slowness of the tractor."""
PLAY_CUT_OFF_HZ = 8.0
"""Cut-off before the play [Hz], so that the jumps of a sensor that turns round before the wheels stay sharp."""
SETTLE_S = 2.0
"""Time at the start that is left out, until start and play are forgotten [s]."""
LEAST_SAMPLES = 12
"""Least number of samples of a channel in a window: 2.4 Hz."""
LONGEST_PAUSE_S = 0.5
"""Time between two samples of a window beyond which it has a gap [s], two and a half times the spacing at least."""
FULL = 0.95
"""Share of the samples that a receiver without a fault would send that a window needs [-]."""


class WindowedChannel(NamedTuple):
    """A measured quantity in windows."""

    t: Array
    """Times, shape (windows, n) [s]."""
    value: Array
    """Values, shape (windows, n), or (windows, n, 2) for positions."""

    @property
    def spacing(self) -> float:
        """Mean time between samples [s]."""
        return float(np.mean(np.diff(self.t, axis=1)))


class FitPiece(NamedTuple):
    """Inputs of one piece at the model's steps."""

    recording: FieldRecording
    t: Array
    """Times [s]."""
    steer: Array
    """Recorded wheel angle, without what is faster than `PLAY_CUT_OFF_HZ` [rad]."""
    u: Array
    """Recorded speed, without what is faster than `CUT_OFF_HZ` [m/s]."""
    heading: Callable[[Array], Array] | None
    """Recorded heading at other times [rad]."""
    windows: slice
    """Those of the channels' windows that are its own."""


class VehicleData(NamedTuple):
    """Recordings, prepared for the fit."""

    pieces: tuple[FitPiece, ...]
    chassis: Chassis2
    channels: dict[str, WindowedChannel]
    """`yaw_rate` of a gyro, `heading` and `position`, those that there are."""
    steer_noise: float
    """White noise of the recorded angle [rad]."""

    @property
    def windows(self) -> int:
        """Number of windows."""
        return len(next(iter(self.channels.values())).t) if self.channels else 0


def prepare(recordings: Sequence[FieldRecording], chassis: Chassis2) -> VehicleData:
    """Windows of pieces that have a wheel angle, and a yaw rate from a gyro, a heading, or positions."""
    measured = [channels_of(recording) for recording in recordings]
    names = [name for name in ("yaw_rate", "heading", "position") if any(name in each for each in measured)]
    spacings = {name: _spacing([each[name] for each in measured if name in each]) for name in names}
    found, fitted, count = {name: list[TimeSeries]() for name in names}, list[FitPiece](), 0
    for recording, series in zip(recordings, measured, strict=True):
        windows = {name: _windows(recording, series[name], spacings[name]) if name in series else {} for name in names}
        common = sorted(set.intersection(*map(set, windows.values()))) if names else []
        if not common:
            continue
        for name in names:
            found[name] += [windows[name][k] for k in common]
        fitted.append(_piece(recording, slice(count, count + len(common))))
        count += len(common)
    channels = {
        name: WindowedChannel(np.array([w.t for w in each]), np.array([w.value for w in each]))
        for name, each in found.items()
        if each
    }
    return VehicleData(tuple(fitted), chassis, channels, _white_noise(recordings))


def channels_of(recording: FieldRecording) -> dict[str, TimeSeries]:
    """What a recording is compared with; a yaw rate that was derived is its heading or position once more."""
    gyro = recording.yaw_rate if recording.yaw_rate_source == "gyro" else None
    parts = {"yaw_rate": gyro, "heading": recording.heading, "position": recording.position}
    return {name: series for name, series in parts.items() if series is not None and len(series.t) > 1}


def smoothed(values: Array, cut_off: float) -> Array:
    """Values at the model's steps without what is faster than `cut_off` [Hz], in phase."""
    smooth: Array = sosfiltfilt(_low_pass(cut_off), values)
    return smooth


@cache
def _low_pass(cut_off: float) -> Array:
    """Second-order sections at the model's steps."""
    sections: Array = butter(4, cut_off * 2 * STEP_S, output="sos")
    return sections


def _piece(recording: FieldRecording, windows: slice) -> FitPiece:
    t = np.arange(recording.start, recording.end, STEP_S)
    steer = smoothed(recording.steer.at(t), PLAY_CUT_OFF_HZ) if recording.steer else np.zeros(len(t))
    heading = recording.heading.smooth() if recording.heading else None
    return FitPiece(recording, t, steer, smoothed(recording.speed.at(t), CUT_OFF_HZ), heading, windows)


def _white_noise(recordings: Sequence[FieldRecording]) -> float:
    """Noise of the recorded angle, from third differences, blind to slow steering; by the median, deaf to jumps."""
    steers = {id(each.steer): each.steer.value for each in recordings if each.steer is not None}
    off = [np.abs(np.diff(value, 3)) for value in steers.values() if len(value) > 3]
    if not off:
        return 0.0
    # of a normal distribution; 1 + 9 + 9 + 1 variances
    return 1.4826 * float(np.median(np.concatenate(off))) / sqrt(20.0)


def _spacing(series: Sequence[TimeSeries]) -> float:
    """Mean time between samples, gaps left out [s]."""
    steps = np.concatenate([np.diff(each.t) for each in series])
    return float(np.mean(steps[steps < 2.5 * np.median(steps)]))


def _windows(recording: FieldRecording, series: TimeSeries, spacing: float) -> dict[int, TimeSeries]:
    """Complete windows by their number, of equally many samples, at speed all the time."""
    start, end = recording.start + SETTLE_S, recording.end
    n, longest = int(FULL * WINDOW_S / spacing), max(LONGEST_PAUSE_S, 2.5 * spacing)
    fast, found = moving(recording, series.between(start, end)), {}
    for k in range(int((end - start) / WINDOW_S)):
        part = fast.between(start + k * WINDOW_S, start + (k + 1) * WINDOW_S)
        if n >= LEAST_SAMPLES and len(part.t) >= n and np.diff(part.t).max() < longest:
            found[k] = TimeSeries(part.t[:n], part.value[:n])
    return found
