"""What the channels of a recording would say of a vehicle and its sensors, window by window.

A heading and the yaw rate of a gyro are those of the model under the recorded steering. Positions are dead reckoned:
along the recorded heading where there is one, with the model's sideslip at the rear axle, so that a bump that turns the
tractor does not look like an antenna elsewhere; along the model's heading where there is none. Each window is laid on
the recording by what a start that nobody knows leaves free: positions by a shift, without a heading by a turn, too; a
heading by a turn.
"""

from collections.abc import Mapping, Sequence
from math import radians
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import Akima1DInterpolator

from agrobot_mj.core.signals import Array
from agrobot_mj.fieldlogs.identify.model import STEP_S, Lateral, LateralMotion, simulate, wheel_angle
from agrobot_mj.fieldlogs.identify.windows import CUT_OFF_HZ, FitPiece, VehicleData, smoothed

MASS_KG = 750.0
"""Mass of the tractor for which the compliances below are [kg]."""
Channels = dict[str, Array]
"""Values of each channel, shape (windows, n), of positions (windows, n, 2)."""


class Parameter(NamedTuple):
    """A quantity of the fit."""

    start: float
    low: float
    high: float
    scale: float
    """Typical size."""


SENSORS = {
    "gyro_offset": Parameter(0.0, -0.2, 0.2, 0.01),
    "heading_offset": Parameter(0.0, -4.0, 4.0, 0.01),
    "heading_delay_s": Parameter(0.0, -1.5, 1.5, 0.02),
    "position_delay_s": Parameter(0.0, -1.5, 1.5, 0.02),
    "ahead_m": Parameter(0.0, -10.0, 10.0, 0.05),
    "left_m": Parameter(0.0, -10.0, 10.0, 0.05),
}
"""Those that do not change the motion; the place is that of the antenna beside the map's."""
DYNAMICS = {
    "front_compliance": Parameter(5e-5, 0.0, 2e-3, 1e-5),
    "rear_compliance": Parameter(3e-5, 0.0, 2e-3, 1e-5),
    "front_relaxation_m": Parameter(0.3, 0.0, 5.0, 0.1),
    "rear_relaxation_m": Parameter(0.5, 0.0, 5.0, 0.1),
    "steer_offset": Parameter(0.0, -0.3, 0.3, 0.01),
    "steer_scale": Parameter(1.0, 0.3, 3.0, 0.01),
    "steer_delay_s": Parameter(0.02, -1.0, 1.0, 0.02),
    "steer_lag_s": Parameter(0.05, 0.0, 1.0, 0.02),
    "backlash": Parameter(radians(0.2), 0.0, radians(20.0), 0.01),
    "speed_error": Parameter(0.0, -0.3, 0.3, 0.01),
    "speed_delay_s": Parameter(0.0, -1.5, 1.5, 0.02),
}
"""Those of the motion."""
PARAMETERS = SENSORS | DYNAMICS
"""Everything that can be fitted; compliances in rad/N for a tractor of `MASS_KG`, scaled by mass. SI and radians."""


def motion(p: Mapping[str, float], data: VehicleData, piece: FitPiece) -> LateralMotion:
    """Motion of the model with parameters `p` under the inputs of a piece."""
    recorded = piece.steer
    if later := p.get("steer_delay_s"):
        recorded = Akima1DInterpolator(piece.t, recorded, extrapolate=True)(piece.t - later)
    recorded = p.get("steer_scale", 1.0) * recorded - p.get("steer_offset", 0.0)
    delta = wheel_angle(recorded, STEP_S, p.get("backlash", 0.0), p.get("steer_lag_s", 0.0))
    delta = smoothed(delta, CUT_OFF_HZ)
    stiff = 1e-9
    C_f, C_r = (1.0 / max(p[f"{axle}_compliance"], stiff) for axle in ("front", "rear"))
    tyres = Lateral(C_f, C_r, p.get("front_relaxation_m", 0.0), p.get("rear_relaxation_m", 0.0))
    return simulate(data.chassis, tyres, speed(p, piece), delta, STEP_S)


def speed(p: Mapping[str, float], piece: FitPiece) -> Array:
    """Speed at the model's steps [m/s]."""
    found: Array = (1.0 + p.get("speed_error", 0.0)) * np.interp(
        piece.t + p.get("speed_delay_s", 0.0), piece.t, piece.u
    )
    return found


def predictions(p: Mapping[str, float], data: VehicleData, m: Sequence[LateralMotion] | None = None) -> Channels:
    """What the channels would say, positions and headings laid on the recorded positions in each window.

    `m` is the motion of each piece, where that is known.
    """
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
        points = _dead_reckoned(p, piece, m) if turned else _point(p, piece, m.rear_x, m.rear_y, m.yaw)
        at = np.stack([np.interp(t, piece.t, each) for each in points], axis=2)
        found["position"] = laid(at, channel.value[piece.windows], not turned)
    return found


def _dead_reckoned(p: Mapping[str, float], piece: FitPiece, m: LateralMotion) -> tuple[Array, Array]:
    """East and north of the antenna along the recorded heading, each of shape (n,) [m]."""
    assert piece.heading is not None
    yaw = piece.heading(piece.t + p.get("heading_delay_s", 0.0)) - p.get("heading_offset", 0.0)
    u, c, s = speed(p, piece), np.cos(yaw), np.sin(yaw)
    x, y = (cumulative_trapezoid(v, dx=STEP_S, initial=0) for v in (u * c - m.side * s, u * s + m.side * c))
    return _point(p, piece, x, y, yaw)


def _point(p: Mapping[str, float], piece: FitPiece, x: Array, y: Array, yaw: Array) -> tuple[Array, Array]:
    """The antenna above a rear axle at x, y [m]."""
    ahead, left, _ = piece.recording.arm
    ahead, left, c, s = ahead + p.get("ahead_m", 0.0), left + p.get("left_m", 0.0), np.cos(yaw), np.sin(yaw)
    return x + ahead * c - left * s, y + ahead * s + left * c


def laid(points: Array, onto: Array, turned: bool) -> Array:
    """Points (windows, n, 2) after the shift of each window, and the turn, that lay them onto others best."""
    a, b = (each[..., 0] + 1j * each[..., 1] for each in (points, onto))
    middle = b.mean(axis=1, keepdims=True)
    a, b = a - a.mean(axis=1, keepdims=True), b - middle
    if turned:
        a = a * np.exp(1j * np.angle((a.conj() * b).sum(axis=1, keepdims=True)))
    a = a + middle
    return np.stack([a.real, a.imag], axis=2)
