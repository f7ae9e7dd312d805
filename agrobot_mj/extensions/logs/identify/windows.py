"""Windows of recordings for a fit: measured channels and predictions of a vehicle model in each window.

The model predicts heading and gyro yaw rate for the recorded steering. Positions are predicted by dead reckoning along
the recorded heading, if present, with the model's sideslip at the rear axle. Yaw disturbances then do not affect the
predicted positions. Without a recorded heading, positions follow the heading of the model. In each window, the unknown
initial values are fitted: a shift of positions, a rotation of headings and, without a recorded heading, a rotation of
positions.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from math import inf, radians
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import Akima1DInterpolator
from scipy.signal import butter, sosfiltfilt

from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.identify.model import STEP_S, Chassis2, Lateral, LateralMotion, simulate, wheel_angle
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.residuals import moving
from agrobot_mj.extensions.logs.series import TimeSeries, axle_speed, scatter

WINDOW_S = 5.0  # Length of a window [s]: longer than the dynamics, and short enough for many windows per minute
CUT_OFF_HZ = 3.0
"""Cut-off frequency of the low-pass filter of the wheel angle [Hz]. Noise above this frequency would act like a lag."""
SPEED_CUT_OFF_HZ = 1.0
"""Cut-off frequency of the low-pass filter of the speed [Hz]: above the frequencies of tractor motion. With 3 Hz, noise
of a GNSS speed resembles accelerations, and latencies of position and speed differ by 0.2 s between fits of one
machine."""
PLAY_CUT_OFF_HZ = (2.0, 8.0)
"""Range of cut-off frequencies of the wheel-angle filter for the play model [Hz]. High values keep sharp reversals."""
PLAYING = radians(0.1)
"""Target noise of the filtered wheel angle at the input of the play model [rad]. Assumed value: larger noise would move
the wheels through the play and resemble soft tyres."""
SETTLE_S = 2.0  # Time omitted at the start of a segment [s], until the effects of initial state and play have decayed
FIT_S = SETTLE_S + WINDOW_S  # Minimum duration of a segment for a fit [s]
LEAST_SAMPLES = 11  # Minimum number of samples of a channel in a window, which follows from a rate of 2.5 Hz and `FULL`
LONGEST_PAUSE_S = 0.5
"""Maximum time between samples in a window without gaps [s], unless 2.5 times the mean spacing is longer."""
FULL = 0.95  # Minimum number of samples in a window, divided by the nominal number [-]
EVEN, FULL_UNEVEN = 0.9, 0.85
"""Minimum fraction of time steps near the median step for an evenly sampled channel, and value of `FULL` for unevenly
sampled channels [-]. Assumed values: a sensor a third slower than its logger repeats values in irregular rows."""


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
    """Recorded yaw rate of gyro or heading [rad/s] if the recorded speed is that of the antenna. Otherwise None."""
    heading: Callable[[Array], Array] | None
    """Function that interpolates the recorded heading [rad], or None if there is no heading."""
    windows: slice  # Index range of the windows, in each channel, that belong to this segment


class VehicleData(NamedTuple):
    """Recordings prepared for fitting the vehicle model."""

    pieces: tuple[FitPiece, ...]
    chassis: Chassis2
    channels: dict[str, WindowedChannel]
    """Measured channels by name: `yaw_rate` of a gyro, `heading` and `position`. Missing channels have no entry."""
    steer_noise: float  # Standard deviation of white noise in the recorded wheel angle [rad]
    speed_noise: float  # Standard deviation of white noise in the recorded speed [m/s]
    play_cut_off_hz: float  # Cut-off frequency of the low-pass filter of the recorded wheel angle before the play [Hz]

    @property
    def dynamics(self) -> set[str]:
        """Names of the parameters that affect the simulated motion."""
        of_antenna = any(piece.recording.antenna_speed for piece in self.pieces)
        return {*DYNAMICS, *(("ahead_m", "left_m", "heading_delay_s") if of_antenna else ())}

    @property
    def windows(self) -> int:
        """Number of windows in each channel."""
        return len(next(iter(self.channels.values())).t) if self.channels else 0


class TooLittleError(FieldLogError):
    """Exception for a log that is too short or too slow for a fit."""


def enough(recordings: Sequence[FieldRecording], chassis: Chassis2, windows: int) -> VehicleData:
    """Prepare segments for a fit. Raises `TooLittleError` for fewer than `windows` windows."""
    data = prepare(recordings, chassis)
    if data.windows < windows:
        remedy = "use a longer log, several logs or --share 0.9, or remove columns with gaps from the map"
        if np.median([each.end - each.start for each in recordings]) < FIT_S:
            remedy = f"record without pauses, because a fit uses segments of at least {FIT_S:g} s"
        raise TooLittleError(
            f"{recordings[0].name}: the log has {data.windows} complete windows of 5 s in motion with all columns, "
            f"and the fit needs {windows}; {remedy}"
        )
    return data


def prepare(recordings: Sequence[FieldRecording], chassis: Chassis2) -> VehicleData:
    """Prepare segments for a fit. Each segment must have a wheel angle, and a gyro yaw rate, a heading or positions."""
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
    """Return the independent channels of a recording: heading, position, and yaw rate if measured by a gyro."""
    gyro = recording.yaw_rate if recording.yaw_rate_source == "gyro" else None
    parts = {"yaw_rate": gyro, "heading": recording.heading, "position": recording.position}
    return {name: series for name, series in parts.items() if series is not None and len(series.t) > 1}


def smoothed(values: Array, cut_off: float) -> Array:
    """Return values at the time steps of the model after a zero-phase low-pass filter at `cut_off` [Hz]."""
    smooth: Array = sosfiltfilt(_low_pass(cut_off), values)
    return smooth


@cache
def _low_pass(cut_off: float) -> Array:
    """Return a low-pass filter for the time steps of the model, as second-order sections."""
    sections: Array = butter(4, cut_off * 2 * STEP_S, output="sos")
    return sections


def _piece(recording: FieldRecording, windows: slice, cut_off: float) -> FitPiece:
    t = np.arange(recording.start, recording.end, STEP_S)
    steer = smoothed(recording.steer.at(t), cut_off) if recording.steer else np.zeros(len(t))
    heading, u, rate = recording.heading.smooth() if recording.heading else None, recording.speed.at(t), None
    if recording.antenna_speed and recording.yaw_rate:
        rate, (ahead, left, _) = np.interp(t, *recording.yaw_rate), recording.arm
        u = np.sign(u) * np.hypot(u - left * rate, ahead * rate)
        if recording.yaw_rate_source == "course":
            rate = None  # the course rate differs from the yaw rate of a machine with its antenna ahead
        elif heading and recording.yaw_rate_source == "heading":  # sharper than the derivative of local cubic fits
            rate = np.gradient(smoothed(heading(t), CUT_OFF_HZ), STEP_S)
    return FitPiece(recording, t, steer, smoothed(u, SPEED_CUT_OFF_HZ), rate, heading, windows)


def _white_noise(recordings: Sequence[FieldRecording], part: str) -> float:
    """Return the standard deviation of white noise in the input `part`. A series shared by segments counts once."""
    return scatter(*{id(series): series.value for each in recordings if (series := getattr(each, part))}.values())


def _play_cut_off(recordings: Sequence[FieldRecording], noise: float) -> float:
    """Return the cut-off frequency at which the filtered wheel angle has the noise `PLAYING` [Hz]."""
    steered = [each.steer for each in recordings if each.steer is not None and len(each.steer.t) > 1]
    share = (PLAYING / max(noise, 1e-9)) ** 2  # fraction of the band below half the sample rate
    return float(np.clip(share / (2 * _spacing(steered)) if steered else inf, *PLAY_CUT_OFF_HZ))


def _spacing(series: Sequence[TimeSeries]) -> float:
    """Return the mean sampling interval, excluding gaps [s]."""
    steps = np.concatenate([np.diff(each.t) for each in series])
    return float(np.mean(steps[steps < 2.5 * np.median(steps)]))


def _rate(series: Sequence[TimeSeries]) -> tuple[float, float]:
    """Return the mean sampling interval, excluding gaps [s], and the minimum fraction of samples in a window [-]."""
    steps = np.concatenate([np.diff(each.t) for each in series])
    usual = float(np.median(steps))
    steps = steps[steps < max(LONGEST_PAUSE_S, 2.5 * usual)]
    if np.mean(np.abs(steps - usual) < usual / 2) > EVEN:
        return _spacing(series), FULL
    return float(np.mean(steps)), FULL_UNEVEN


def _windows(recording: FieldRecording, series: TimeSeries, spacing: float, full: float) -> dict[int, TimeSeries]:
    """Return the complete windows in which the machine moves, keyed by window number, with equal numbers of samples."""
    start, end = recording.start + SETTLE_S, recording.end
    n, longest = int(full * WINDOW_S / spacing), max(LONGEST_PAUSE_S, 2.5 * spacing)
    fast, found = moving(recording, series.between(start, end)), {}
    for k in range(int((end - start) / WINDOW_S)):
        part = fast.between(start + k * WINDOW_S, start + (k + 1) * WINDOW_S)
        if n >= LEAST_SAMPLES and len(part.t) >= n and np.diff(part.t).max() < longest:
            found[k] = TimeSeries(part.t[:n], part.value[:n])
    return found


MASS_KG = 750.0  # Mass of the tractor for which `DYNAMICS` contains the compliances [kg]
Channels = dict[str, Array]  # Values by channel, shape (windows, n), or (windows, n, 2) for positions


class Parameter(NamedTuple):
    """Initial value, bounds and scale of a parameter to be fitted."""

    start: float
    low: float
    high: float
    scale: float  # Typical magnitude of the parameter


SENSORS = {
    "gyro_offset": Parameter(0.0, -0.2, 0.2, 0.01),
    "heading_offset": Parameter(0.0, -4.0, 4.0, 0.01),
    "heading_delay_s": Parameter(0.0, -1.5, 1.5, 0.02),
    "position_delay_s": Parameter(0.0, -1.5, 1.5, 0.02),
    "ahead_m": Parameter(0.0, -10.0, 10.0, 0.05),
    "left_m": Parameter(0.0, -10.0, 10.0, 0.05),
    "lean_s2": Parameter(0.01, -0.05, 0.3, 0.01),
}
"""Sensor parameters. If the recorded speed is that of the antenna, the antenna position (relative to the map) and the
heading latency also affect the simulated motion. Body roll shifts the antenna outwards by `lean_s2` times the
lateral acceleration."""
DYNAMICS = {
    "front_compliance": Parameter(5e-5, 0.0, 2e-3, 1e-5),
    "rear_compliance": Parameter(3e-5, 0.0, 2e-3, 1e-5),
    "front_relaxation_m": Parameter(0.3, 0.0, 5.0, 0.1),
    "rear_relaxation_m": Parameter(0.5, 0.0, 5.0, 0.1),
    "steer_offset": Parameter(0.0, -0.3, 0.3, 0.01),
    "steer_scale": Parameter(1.0, 0.3, 3.0, 0.01),
    "steer_right": Parameter(1.0, 0.1, 10.0, 0.01),
    "steer_delay_s": Parameter(0.02, -1.0, 1.0, 0.02),
    "steer_lag_s": Parameter(0.05, 0.0, 1.0, 0.02),
    "backlash": Parameter(radians(0.2), 0.0, radians(20.0), 0.01),
    "speed_error": Parameter(0.0, -0.3, 0.3, 0.01),
    "speed_delay_s": Parameter(0.0, -1.5, 1.5, 0.02),
}
"""Parameters that always affect the simulated motion."""
PARAMETERS = SENSORS | DYNAMICS
"""All identifiable parameters [SI, rad]. Compliances are for a tractor of `MASS_KG` and scale with the mass."""


def motion(p: Mapping[str, float], data: VehicleData, piece: FitPiece) -> LateralMotion:
    """Simulate the motion in a segment with the parameters `p`."""
    recorded = piece.steer
    if later := p.get("steer_delay_s"):
        recorded = Akima1DInterpolator(piece.t, recorded, extrapolate=True)(piece.t - later)
    delta = wheel_angle(sensed(p, recorded), STEP_S, p.get("backlash", 0.0), p.get("steer_lag_s", 0.0))
    delta = smoothed(delta, CUT_OFF_HZ)
    stiff = 1e-9
    C_f, C_r = (1.0 / max(p[f"{axle}_compliance"], stiff) for axle in ("front", "rear"))
    tyres = Lateral(C_f, C_r, p.get("front_relaxation_m", 0.0), p.get("rear_relaxation_m", 0.0))
    u = speed(p, piece)
    found = simulate(data.chassis, tyres, u, delta, STEP_S)
    if piece.recording.antenna_speed and piece.yaw_rate is None:
        u = axle_speed(u, found.yaw_rate, *_place(p, piece))
        found = simulate(data.chassis, tyres, u, delta, STEP_S)
    return found


def sensed(p: Mapping[str, float], recorded: Array) -> Array:
    """Return the true steering angles [rad] for recorded angles, with the fitted scale and offset."""
    angle = p.get("steer_scale", 1.0) * recorded - p.get("steer_offset", 0.0)
    return np.where(angle < 0, p.get("steer_right", 1.0) * angle, angle)


def speed(p: Mapping[str, float], piece: FitPiece) -> Array:
    """Return the speed of the rear axle at the time steps of the model [m/s]."""
    found: Array = (1.0 + p.get("speed_error", 0.0)) * np.interp(
        piece.t + p.get("speed_delay_s", 0.0), piece.t, piece.u
    )
    if piece.yaw_rate is None:
        return found
    later = p.get("heading_delay_s", 0.0) if piece.recording.yaw_rate_source == "heading" else 0.0
    return axle_speed(found, np.interp(piece.t + later, piece.t, piece.yaw_rate), *_place(p, piece))


def _place(p: Mapping[str, float], piece: FitPiece) -> tuple[float, float]:
    """Return the distances [m] of the antenna ahead and to the left of the rear-axle centre."""
    ahead, left, _ = piece.recording.arm
    return ahead + p.get("ahead_m", 0.0), left + p.get("left_m", 0.0)


def predictions(p: Mapping[str, float], data: VehicleData, m: Sequence[LateralMotion] | None = None) -> Channels:
    """Return the predicted values by channel. Positions and headings are aligned with the recording in each window. `m`
    is the simulated motion of each segment; if None, it is simulated first."""
    m = [motion(p, data, piece) for piece in data.pieces] if m is None else m
    each = [_of_piece(p, data, piece, moved) for piece, moved in zip(data.pieces, m, strict=True)]
    return {name: np.concatenate([part[name] for part in each]) for name in data.channels}


def _of_piece(p: Mapping[str, float], data: VehicleData, piece: FitPiece, m: LateralMotion) -> Channels:
    found = Channels()
    if channel := data.channels.get("yaw_rate"):
        found["yaw_rate"] = np.interp(channel.t[piece.windows], piece.t, m.yaw_rate) + p.get("gyro_offset", 0.0)
    if channel := data.channels.get("heading"):
        yaw = np.interp(channel.t[piece.windows] - p.get("heading_delay_s", 0.0), piece.t, m.yaw)
        found["heading"] = yaw + (channel.value[piece.windows] - yaw).mean(axis=1, keepdims=True)
    if channel := data.channels.get("position"):
        t, turned = channel.t[piece.windows] - p.get("position_delay_s", 0.0), "heading" in found
        points = (
            _dead_reckoned(p, piece, m)
            if turned
            else _point(p, piece, speed(p, piece) * m.yaw_rate, m.rear_x, m.rear_y, m.yaw)
        )
        at = np.stack([np.interp(t, piece.t, each) for each in points], axis=2)
        found["position"] = laid(at, channel.value[piece.windows], not turned)
    return found


def _dead_reckoned(p: Mapping[str, float], piece: FitPiece, m: LateralMotion) -> tuple[Array, Array]:
    """Return east and north coordinates of the antenna by dead reckoning along the recorded heading, (n,) [m]."""
    assert piece.heading is not None
    yaw = piece.heading(piece.t + p.get("heading_delay_s", 0.0)) - p.get("heading_offset", 0.0)
    u, c, s = speed(p, piece), np.cos(yaw), np.sin(yaw)
    x, y = (cumulative_trapezoid(v, dx=STEP_S, initial=0) for v in (u * c - m.side * s, u * s + m.side * c))
    return _point(p, piece, u * m.yaw_rate, x, y, yaw)


def _point(p: Mapping[str, float], piece: FitPiece, side: Array, x: Array, y: Array, yaw: Array) -> tuple[Array, Array]:
    """Return the east and north coordinates of the antenna [m] for rear-axle positions x, y [m], headings `yaw` [rad]
    and lateral accelerations `side` [m/s2]."""
    (ahead, left), c, s = _place(p, piece), np.cos(yaw), np.sin(yaw)
    beside = left - p.get("lean_s2", 0.0) * side
    return x + ahead * c - beside * s, y + ahead * s + beside * c


def laid(points: Array, onto: Array, turned: bool) -> Array:
    """Shift `points` (windows, n, 2), and rotate them if `turned`, in each window to fit the points `onto`."""
    a, b = (each[..., 0] + 1j * each[..., 1] for each in (points, onto))
    middle = b.mean(axis=1, keepdims=True)
    a, b = a - a.mean(axis=1, keepdims=True), b - middle
    if turned:
        a = a * np.exp(1j * np.angle((a.conj() * b).sum(axis=1, keepdims=True)))
    a = a + middle
    return np.stack([a.real, a.imag], axis=2)
