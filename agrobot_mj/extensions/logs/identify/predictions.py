"""Predictions of a vehicle model in the windows of a recording, and the parameters of the model and the sensors.

The model predicts heading and gyro yaw rate for the recorded steering. Positions are predicted by dead reckoning along
the recorded heading, if present, with the model's sideslip at the rear axle. Yaw disturbances then do not affect the
predicted positions. Without a recorded heading, positions follow the heading of the model. In each window, the unknown
initial values are fitted: a shift of positions, a rotation of headings and, without a recorded heading, a rotation of
positions.
"""

from collections.abc import Mapping, Sequence
from math import radians
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import Akima1DInterpolator

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.logs.identify.model import STEP_S, Lateral, LateralMotion, simulate, wheel_angle
from agrobot_mj.extensions.logs.identify.windows import CUT_OFF_HZ, FitPiece, VehicleData, low_pass
from agrobot_mj.extensions.logs.series import axle_speed

MASS_KG = 750.0  # Tractor mass to which the compliances in `DYNAMICS` refer [kg]
Channels = dict[str, Array]
"""Measured or predicted values by channel name, shape (windows, n), or (windows, n, 2) for positions."""


class Parameter(NamedTuple):
    """Initial value, bounds and scale of a fitted parameter."""

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
"""Sensor parameters. If the recorded speed is the speed of the antenna, the antenna position (as difference from the
column map) and the heading latency also affect the simulated motion. Body roll shifts the antenna outwards by `lean_s2`
times the lateral acceleration."""
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
"""Parameters of tyres, steering and recorded speed, which always affect the simulated motion."""
PARAMETERS = SENSORS | DYNAMICS
"""All identifiable parameters [SI, rad]. Compliances are for a tractor of `MASS_KG` and scale with the mass."""


def dynamics_of(data: VehicleData) -> set[str]:
    """Return the names of the parameters that affect the simulated motion of a log."""
    of_antenna = any(piece.recording.antenna_speed for piece in data.pieces)
    return {*DYNAMICS, *(("ahead_m", "left_m", "heading_delay_s") if of_antenna else ())}


def motion(p: Mapping[str, float], data: VehicleData, piece: FitPiece) -> LateralMotion:
    """Simulate the motion in a segment with the parameters `p`, from the recorded wheel angle and speed."""
    recorded = piece.steer
    if later := p.get("steer_delay_s"):
        recorded = Akima1DInterpolator(piece.t, recorded, extrapolate=True)(piece.t - later)
    delta = wheel_angle(true_wheel_angles(p, recorded), STEP_S, p.get("backlash", 0.0), p.get("steer_lag_s", 0.0))
    delta = low_pass(delta, CUT_OFF_HZ)
    stiff = 1e-9
    C_f, C_r = (1.0 / max(p[f"{axle}_compliance"], stiff) for axle in ("front", "rear"))
    tyres = Lateral(C_f, C_r, p.get("front_relaxation_m", 0.0), p.get("rear_relaxation_m", 0.0))
    u = rear_axle_speed(p, piece)
    found = simulate(data.chassis, tyres, u, delta, STEP_S)
    if piece.recording.antenna_speed and piece.yaw_rate is None:
        u = axle_speed(u, found.yaw_rate, *_place(p, piece))
        found = simulate(data.chassis, tyres, u, delta, STEP_S)
    return found


def true_wheel_angles(p: Mapping[str, float], recorded: Array) -> Array:
    """Return the true wheel angles [rad] for recorded angles [rad], with the offset and the scales in `p`."""
    angle = p.get("steer_scale", 1.0) * recorded - p.get("steer_offset", 0.0)
    return np.where(angle < 0, p.get("steer_right", 1.0) * angle, angle)


def rear_axle_speed(p: Mapping[str, float], piece: FitPiece) -> Array:
    """Return the speed of the rear axle at the time steps of the model [m/s], corrected with the parameters `p`."""
    found: Array = (1.0 + p.get("speed_error", 0.0)) * np.interp(
        piece.t + p.get("speed_delay_s", 0.0), piece.t, piece.u
    )
    if piece.yaw_rate is None:
        return found
    later = p.get("heading_delay_s", 0.0) if piece.recording.yaw_rate_source == "heading" else 0.0
    return axle_speed(found, np.interp(piece.t + later, piece.t, piece.yaw_rate), *_place(p, piece))


def _place(p: Mapping[str, float], piece: FitPiece) -> tuple[float, float]:
    """Return the fitted distances of the antenna ahead and to the left of the rear-axle centre [m]."""
    ahead, left, _ = piece.recording.arm
    return ahead + p.get("ahead_m", 0.0), left + p.get("left_m", 0.0)


def predictions(p: Mapping[str, float], data: VehicleData, m: Sequence[LateralMotion] | None = None) -> Channels:
    """Return the predicted values by channel name. Positions and headings are aligned with the recording in each
    window. `m` is the simulated motion of each segment. If `m` is None, the motion is simulated first."""
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
            else _point(p, piece, rear_axle_speed(p, piece) * m.yaw_rate, m.rear_x, m.rear_y, m.yaw)
        )
        at = np.stack([np.interp(t, piece.t, each) for each in points], axis=2)
        found["position"] = fit_to_positions(at, channel.value[piece.windows], not turned)
    return found


def _dead_reckoned(p: Mapping[str, float], piece: FitPiece, m: LateralMotion) -> tuple[Array, Array]:
    """Return east and north coordinates of the antenna by dead reckoning along the recorded heading, (n,) [m]."""
    assert piece.heading is not None
    later = piece.t + p.get("heading_delay_s", 0.0)
    yaw = np.interp(later, piece.t, piece.heading) - p.get("heading_offset", 0.0)
    u, c, s = rear_axle_speed(p, piece), np.cos(yaw), np.sin(yaw)
    x, y = (cumulative_trapezoid(v, dx=STEP_S, initial=0) for v in (u * c - m.side * s, u * s + m.side * c))
    return _point(p, piece, u * m.yaw_rate, x, y, yaw)


def _point(p: Mapping[str, float], piece: FitPiece, side: Array, x: Array, y: Array, yaw: Array) -> tuple[Array, Array]:
    """Return the east and north coordinates of the antenna [m] for rear-axle positions `x`, `y` [m], headings `yaw`
    [rad] and lateral accelerations `side` [m/s2]."""
    (ahead, left), c, s = _place(p, piece), np.cos(yaw), np.sin(yaw)
    beside = left - p.get("lean_s2", 0.0) * side
    return x + ahead * c - beside * s, y + ahead * s + beside * c


def fit_to_positions(points: Array, onto: Array, turned: bool) -> Array:
    """Return `points` (windows, n, 2), shifted and, if `turned`, rotated in each window to fit the points `onto`."""
    a, b = (each[..., 0] + 1j * each[..., 1] for each in (points, onto))
    middle = b.mean(axis=1, keepdims=True)
    a, b = a - a.mean(axis=1, keepdims=True), b - middle
    if turned:
        a = a * np.exp(1j * np.angle((a.conj() * b).sum(axis=1, keepdims=True)))
    a = a + middle
    return np.stack([a.real, a.imag], axis=2)
