"""Windows of recordings for a fit: measured channels and model inputs in each window."""

from collections.abc import Sequence
from functools import cache
from math import inf, radians
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.identify.model import STEP_S, Chassis2
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.residuals import moving
from agrobot_mj.extensions.logs.series import TimeSeries, scatter

WINDOW_S = 5.0  # Length of a window [s]: longer than the yaw dynamics, and short enough for many windows per minute
CUT_OFF_HZ = 3.0
"""Cut-off frequency of the low-pass filter of the wheel angle [Hz]. Noise above this frequency would act like a lag."""
SPEED_CUT_OFF_HZ = 1.0
"""Cut-off frequency of the low-pass filter of the speed [Hz]: above the frequencies of tractor motion. With 3 Hz, noise
of a GNSS speed resembles accelerations, and latencies of position and speed differ by 0.2 s between fits of one
machine."""
PLAY_CUT_OFF_HZ = (2.0, 8.0)
"""Range of cut-off frequencies of the wheel-angle filter for the play model [Hz]. High values keep sharp reversals."""
PLAYING = radians(0.1)
"""Target noise of the filtered wheel angle at the input of the play model [rad]. Assumed value: with more noise, the
wheels of the model would move within the play, which resembles soft tyres."""
SETTLE_S = 2.0  # Time omitted at the start of a segment [s], until the effects of initial state and play have decayed
FIT_S = SETTLE_S + WINDOW_S  # Minimum duration of a segment for a fit [s]
LEAST_SAMPLES = 11  # Minimum number of samples of a channel in a window, which follows from a rate of 2.5 Hz and `FULL`
LONGEST_PAUSE_S = 0.5
"""Maximum time between samples in a window without gaps [s], unless 2.5 times the mean spacing is longer."""
FULL = 0.95  # Minimum number of samples in a complete window, divided by the nominal number [-]
EVEN, FULL_UNEVEN = 0.9, 0.85
"""Minimum fraction of time steps near the median step for an evenly sampled channel [-], and value of `FULL` for other
channels [-]. Assumed values: a sensor a third slower than its logger repeats values in irregular rows."""


class WindowedChannel(NamedTuple):
    """Measured values of a channel, divided into windows."""

    t: Array  # Times [s], shape (windows, n)
    value: Array  # Values, shape (windows, n), or (windows, n, 2) for positions

    @property
    def spacing(self) -> float:
        """Mean time between samples [s]."""
        return float(np.mean(np.diff(self.t, axis=1)))


class FitPiece(NamedTuple):
    """Inputs of one segment of a log, sampled at the time steps of the model."""

    recording: FieldRecording
    t: Array  # Times [s]
    steer: Array  # Recorded wheel angle after a low-pass filter with `VehicleData.play_cut_off_hz` [rad]
    u: Array  # Recorded speed of rear axle or antenna after a low-pass filter with `SPEED_CUT_OFF_HZ` [m/s]
    yaw_rate: Array | None
    """Yaw rate from gyro or heading for converting the recorded antenna speed to the rear axle [rad/s]. None if no
    conversion is needed, or if the yaw rate comes from the course."""
    heading: Array | None  # Recorded heading after a low-pass filter [rad], or None if there is no heading
    windows: slice  # Index range of the windows, in each channel, that belong to this segment


class VehicleData(NamedTuple):
    """Segments of recordings prepared for fitting the vehicle model."""

    pieces: tuple[FitPiece, ...]
    chassis: Chassis2
    channels: dict[str, WindowedChannel]
    """Measured channels by name: `yaw_rate` of a gyro, `heading` and `position`. Missing channels have no entry."""
    steer_noise: float  # Standard deviation of white noise in the recorded wheel angle [rad]
    speed_noise: float  # Standard deviation of white noise in the recorded speed [m/s]
    play_cut_off_hz: float  # Cut-off frequency of the low-pass filter of the recorded wheel angle before the play [Hz]

    @property
    def windows(self) -> int:
        """Number of windows in each channel."""
        return len(next(iter(self.channels.values())).t) if self.channels else 0


class TooLittleError(FieldLogError):
    """Exception for a log that is too short or too slow for a fit."""


def enough(recordings: Sequence[FieldRecording], chassis: Chassis2, windows: int) -> VehicleData:
    """Prepare segments for a fit. Raises `TooLittleError` if the segments have fewer than `windows` complete time
    windows."""
    data = prepare(recordings, chassis)
    if data.windows < windows:
        remedy = "use a longer log, several logs or --share 0.9, or remove columns with gaps from the map"
        if np.median([each.end - each.start for each in recordings]) < FIT_S:
            remedy = f"record without pauses, because a fit uses segments of at least {FIT_S:g} s"
        raise TooLittleError(
            f"{recordings[0].name}: the log has {data.windows} complete windows of 5 s in motion with all columns, "
            f"but the fit needs {windows}; {remedy}"
        )
    return data


def prepare(recordings: Sequence[FieldRecording], chassis: Chassis2) -> VehicleData:
    """Prepare segments for a fit. A segment is omitted if it lacks a channel (`channels_of`) that another segment
    has."""
    measured = [channels_of(recording) for recording in recordings]
    names = [name for name in ("yaw_rate", "heading", "position") if any(name in each for each in measured)]
    rates = {name: _rate([each[name] for each in measured if name in each]) for name in names}
    steer_noise, speed_noise = (_white_noise(recordings, part) for part in ("steer", "speed"))
    cut_off = _play_cut_off(recordings, steer_noise)
    found, fitted, count = {name: list[TimeSeries]() for name in names}, list[FitPiece](), 0
    for recording, series in zip(recordings, measured, strict=True):
        windows = {name: _windows(recording, series[name], *rates[name]) if name in series else {} for name in names}
        common = sorted(set.intersection(*map(set, windows.values()))) if names else []
        if not common:
            continue
        for name in names:
            found[name] += [windows[name][k] for k in common]
        fitted.append(_piece(recording, slice(count, count + len(common)), cut_off))
        count += len(common)
    channels = {
        name: WindowedChannel(np.array([w.t for w in each]), np.array([w.value for w in each]))
        for name, each in found.items()
        if each
    }
    return VehicleData(tuple(fitted), chassis, channels, steer_noise, speed_noise, cut_off)


def channels_of(recording: FieldRecording) -> dict[str, TimeSeries]:
    """Return the independent channels of a recording by name: heading, position, and yaw rate of a gyro."""
    gyro = recording.yaw_rate if recording.yaw_rate_source == "gyro" else None
    parts = {"yaw_rate": gyro, "heading": recording.heading, "position": recording.position}
    return {name: series for name, series in parts.items() if series is not None and len(series.t) > 1}


def low_pass(values: Array, cut_off: float) -> Array:
    """Return `values` at the time steps of the model after a zero-phase low-pass filter at `cut_off` [Hz]."""
    smooth: Array = sosfiltfilt(_low_pass(cut_off), values)
    return smooth


@cache
def _low_pass(cut_off: float) -> Array:
    """Return a low-pass filter at `cut_off` [Hz] for the time steps of the model, as second-order sections."""
    sections: Array = butter(4, cut_off * 2 * STEP_S, output="sos")
    return sections


def _piece(recording: FieldRecording, windows: slice, cut_off: float) -> FitPiece:
    t = np.arange(recording.start, recording.end, STEP_S)
    steer = low_pass(recording.steer.at(t), cut_off) if recording.steer else np.zeros(len(t))
    heading, u, rate = _smooth_heading(recording.heading, t) if recording.heading else None, recording.speed.at(t), None
    if recording.antenna_speed and recording.yaw_rate:
        rate, (ahead, left, _) = np.interp(t, *recording.yaw_rate), recording.arm
        u = np.sign(u) * np.hypot(u - left * rate, ahead * rate)
        if recording.yaw_rate_source == "course":
            rate = None  # the course rate differs from the yaw rate of a machine with its antenna ahead
        elif heading is not None and recording.yaw_rate_source == "heading":
            rate = np.gradient(heading, STEP_S)  # sharper than the derivative of local cubic fits
    return FitPiece(recording, t, steer, low_pass(u, SPEED_CUT_OFF_HZ), rate, heading, windows)


def _smooth_heading(heading: TimeSeries, t: Array) -> Array:
    """Return the heading at times `t` [rad] after a low-pass filter at a quarter of the sample rate or less.

    Without the filter, the noise between samples is less than the noise at samples. The fit would then prefer latencies
    at which positions depend on headings between samples.
    """
    return low_pass(heading.at(t), min(CUT_OFF_HZ, 0.25 / _spacing([heading])))


def _white_noise(recordings: Sequence[FieldRecording], part: str) -> float:
    """Return the standard deviation of white noise in an input. A series shared by segments counts once."""
    return scatter(*{id(series): series.value for each in recordings if (series := getattr(each, part))}.values())


def _play_cut_off(recordings: Sequence[FieldRecording], noise: float) -> float:
    """Return the cut-off frequency at which the filtered wheel angle has the noise `PLAYING`, limited to the range
    `PLAY_CUT_OFF_HZ` [Hz]."""
    steered = [each.steer for each in recordings if each.steer is not None and len(each.steer.t) > 1]
    share = (PLAYING / max(noise, 1e-9)) ** 2  # fraction of the band below half the sample rate
    return float(np.clip(share / (2 * _spacing(steered)) if steered else inf, *PLAY_CUT_OFF_HZ))


def _spacing(series: Sequence[TimeSeries]) -> float:
    """Return the mean sampling interval [s], excluding gaps."""
    steps = np.concatenate([np.diff(each.t) for each in series])
    return float(np.mean(steps[steps < 2.5 * np.median(steps)]))


def _rate(series: Sequence[TimeSeries]) -> tuple[float, float]:
    """Return the mean sampling interval [s], excluding gaps, and the minimum fraction of samples in a window [-]."""
    steps = np.concatenate([np.diff(each.t) for each in series])
    usual = float(np.median(steps))
    steps = steps[steps < max(LONGEST_PAUSE_S, 2.5 * usual)]
    if np.mean(np.abs(steps - usual) < usual / 2) > EVEN:
        return _spacing(series), FULL
    return float(np.mean(steps)), FULL_UNEVEN


def _windows(recording: FieldRecording, series: TimeSeries, spacing: float, full: float) -> dict[int, TimeSeries]:
    """Return the complete windows in motion by window number. All windows have equal numbers of samples."""
    start, end = recording.start + SETTLE_S, recording.end
    n, longest = int(full * WINDOW_S / spacing), max(LONGEST_PAUSE_S, 2.5 * spacing)
    fast, found = moving(recording, series.between(start, end)), {}
    for k in range(int((end - start) / WINDOW_S)):
        part = fast.between(start + k * WINDOW_S, start + (k + 1) * WINDOW_S)
        if n >= LEAST_SAMPLES and len(part.t) >= n and np.diff(part.t).max() < longest:
            found[k] = TimeSeries(part.t[:n], part.value[:n])
    return found
