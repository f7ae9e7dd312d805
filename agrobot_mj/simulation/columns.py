"""Table of the signals of a log: name, unit, description, and source of each value.

The table defines the rows of the log, the Parquet file with its metadata, the units of plots, and the page
docs/reference/columns.md. Units are SI, angles in radians. A missing value is NaN, or null in the file.

Stages report the signals without a source: guidance laws, estimators and sensors declare `columns` and return their
values from `report(state)`. Reported signals that are missing in this table are appended.
"""

from collections.abc import Iterable
from math import nan
from types import GenericAlias
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.control.base import YAW_COLUMNS
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, stage
from agrobot_mj.core.signals import (
    NO_FIX,
    WHEELS,
    Column,
    Command,
    Drive,
    Estimate,
    Fix,
    Measurement,
    Reference,
    Truth,
    Vector,
)


class Tick(NamedTuple):
    """Messages of one tick, from which the log row is computed."""

    truth: Held[Truth]
    measured: Measurement
    estimate: Held[Estimate]
    reference: Reference
    z_ref: float  # Height of the ground below the reference [m]
    command: Command  # Command of the guidance law
    steer_ref: float  # Setpoint of the steering loop [rad]
    pedal_ref: float  # Pedal position commanded by the speed loop [-]
    drive: Drive
    saturated: bool  # Whether the steering command is at its limit
    faults: int  # Number of active faults
    actuation: tuple[float, float, float]
    """Oil flow [m3/s], cylinder pressure [Pa] and torque on the driven wheels [N m] at the end of the last tick."""


class Signal(NamedTuple):
    """Column of the log with the source of its values."""

    column: Column
    value: str | None  # Python expression of the variables of `_written`, or None for a value reported by a stage


def _signals(*rows: tuple[str, str, str, str]) -> tuple[Signal, ...]:
    return tuple(Signal(Column(name, unit, text), value) for name, unit, text, value in rows)


_REFERENCE = _signals(
    ("t", "s", "time since the start", "truth.t"),
    ("x_ref", "m", "reference of the CG, east", "reference.x"),
    ("y_ref", "m", "reference of the CG, north", "reference.y"),
    ("z_ref", "m", "height of the ground under the reference", "z_ref"),
    ("yaw_ref", "rad", "heading of the reference, from east, counter-clockwise", "reference.yaw"),
    ("curvature_ref", "1/m", "curvature of the path at the reference, left positive", "reference.curvature"),
    ("curvature_rate_ref", "1/(m s)", "time derivative of ref.curvature, 0 at its steps", "reference.curvature_rate"),
)
_TRUTH = _signals(
    ("x", "m", "true CG, east", "truth.x"),
    ("y", "m", "true CG, north", "truth.y"),
    ("z", "m", "true CG, up", "truth.z"),
    ("yaw", "rad", "true heading, from east, counter-clockwise, wrapped", "truth.yaw"),
    ("pitch", "rad", "true pitch, nose down positive", "truth.pitch"),
    ("roll", "rad", "true roll, left side up positive", "truth.roll"),
    ("speed", "m/s", "true velocity of the CG along the heading", "truth.speed"),
    ("lateral_speed", "m/s", "true velocity of the CG to the left of the heading", "truth.lateral_speed"),
    ("yaw_rate", "rad/s", "true yaw rate, left positive", "truth.yaw_rate"),
    ("rear_x", "m", "true R, the point below the rear axle's centre, east", "truth.rear_x"),
    ("rear_y", "m", "true R, north", "truth.rear_y"),
)
_ESTIMATE = _signals(
    ("x_hat", "m", "estimated CG, east", "estimate.x"),
    ("y_hat", "m", "estimated CG, north", "estimate.y"),
    ("yaw_hat", "rad", "estimated heading, wrapped", "estimate.yaw"),
    ("speed_hat", "m/s", "estimated velocity along the heading", "estimate.speed"),
    ("yaw_rate_hat", "rad/s", "estimated yaw rate", "estimate.yaw_rate"),
    ("steer_bias_hat", "rad", "estimated bias of the steering sensor; null if not estimated", "estimate.steer_bias"),
    ("rear_x_hat", "m", "estimated R, east", "estimate.rear_x"),
    ("rear_y_hat", "m", "estimated R, north", "estimate.rear_y"),
    ("p_xx", "m2", "estimated variance of R, east", "p_xx"),
    ("p_xy", "m2", "estimated covariance of R, east and north", "p_xy"),
    ("p_yy", "m2", "estimated variance of R, north", "p_yy"),
    ("p_yaw", "rad2", "estimated variance of the heading", "p_yaw"),
    ("position_nees", "-", "normalised estimation error squared of R, 2 on average if consistent", "nees"),
    ("position_nis", "-", "normalised innovation squared of the fix; null without a fix", "estimate.nis"),
)
_CONDITIONS = _signals(
    ("gnss_x", "m", "GNSS solution of the antenna, east; null without a solution", "fix.x"),
    ("gnss_y", "m", "GNSS solution of the antenna, north; null without a solution", "fix.y"),
    ("gnss_quality", "-", "quality of the GNSS solution: 2 fix, 1 float, 3 DGPS, 0 none", "quality"),
    ("faults_active", "-", "number of active scripted faults", "faults"),
)
_ERRORS = _signals(
    ("e_longitudinal", "m", "reference minus true CG, ahead positive (time-based)", "ahead"),
    ("e_lateral", "m", "reference minus true CG, left positive (time-based)", "left"),
    ("speed_ref", "m/s", "speed reference of the guidance law, negative in reverse", "speed_ref"),
)
_ACTUATION = _signals(
    ("steer_ref", "rad", "setpoint of the steering loop, left positive", "steer_ref"),
    ("steer", "rad", "true angle of the virtual wheel in the bicycle model, left positive", "truth.steer"),
    ("steer_measured", "rad", "filtered measurement of the steering potentiometer", "steer_measured"),
    ("steer_saturated", "-", "1 where the steering command is at its limit, else 0", "saturated"),
    ("valve_voltage", "V", "voltage of the steering valve; neutral at 6 V, left above", "drive.steer_voltage"),
    ("pedal_ref", "-", "pedal position commanded by the speed loop, -1 to 1", "pedal_ref"),
    ("pedal", "-", "true pedal position, forward positive", "truth.pedal"),
    ("pedal_measured", "-", "filtered measurement of the pedal", "pedal_measured"),
    ("pedal_voltage", "V", "voltage of the pedal valve, 6 V is neutral; null without power", "drive.pedal_voltage"),
    ("brake", "-", "applied fraction of the brake torque, 0 to 1", "drive.brake"),
    ("valve_flow", "m3/s", "oil flow to the steering cylinder, steering left positive", "actuation[0]"),
    ("steer_pressure", "Pa", "pressure in the steering cylinder; null for a rigid one", "actuation[1]"),
    ("drive_torque", "N m", "total torque on the driven wheels; null without wheels", "actuation[2]"),
)

SIGNALS = (
    *(*_REFERENCE, *_TRUTH, *_ESTIMATE, *_CONDITIONS, *_ERRORS),
    *(Signal(column, None) for column in YAW_COLUMNS),
    *_ACTUATION,
)
"""Signals contained in every log, in the order of the file."""
COLUMNS = tuple(signal.column.name for signal in SIGNALS)  # Names of the columns of every log
WHEEL_SIGNALS = tuple(
    Column(f"{quantity}_{wheel}", unit, f"{text}, wheel {wheel}")
    for quantity, unit, text in (
        ("load", "N", "vertical load"),
        ("slip_angle", "rad", "slip angle"),
        (
            "slip_ratio",
            "-",
            "slip ratio, driving positive and braking negative, ahead and in reverse; at most about 20",
        ),
        ("fx", "N", "force on the wheel, forward in the ground plane"),
        ("fy", "N", "force on the wheel, left in the ground plane"),
        ("friction_use", "-", "force divided by the maximum force of the ground"),
    )
    for wheel in WHEELS
)
"""Additional signals of a plant with wheels, in the order of `RunningPlant.wheels`."""


class Here(NamedTuple):
    """True time, position and pedal position of the tractor, from which the end of a run is determined."""

    t: float
    x: float
    y: float
    pedal: float


_LINES = (
    "def _written(out, truth, fix, estimate, reference, drive, actuation, others):",
    "    truth, estimate, r = fetched(truth), fetched(estimate), reference",
    "    quality, steer_measured, pedal_measured, z_ref, speed_ref, steer_ref, pedal_ref, saturated, faults = others",
    "    ahead, left = to_heading(r.yaw, r.x - truth.x, r.y - truth.y)",
    "    p, dx, dy = estimate.covariance, truth.rear_x - estimate.rear_x, truth.rear_y - estimate.rear_y",
    "    p_xx, p_xy, p_yy, p_yaw = p[0, 0], p[0, 1], p[1, 1], p[2, 2]",
    "    nees, det = p_yy * dx * dx - 2.0 * p_xy * dx * dy + p_xx * dy * dy, p_xx * p_yy - p_xy * p_xy",
    "    nees = nees / det if det > 0.0 else nan",  # an estimator may return a covariance of zeros
    *(f"    out[{k}] = {signal.value or 'nan'}" for k, signal in enumerate(SIGNALS)),
    "    return Here(truth.t, truth.x, truth.y, truth.pedal)",
)
_SCOPE: dict[str, Any] = {"__name__": __name__, "fetched": fetched, "to_heading": to_heading}
_SCOPE |= {"Here": Here, "nan": nan}
exec(compile("\n".join(_LINES), __file__, "exec"), _SCOPE)
_KINDS: tuple[Any, ...] = (Vector, Held[Truth], Fix, Held[Estimate], Reference, Drive, tuple[float, float, float])
write_row: Any = _SCOPE["_written"]
_names = (*write_row.__code__.co_varnames[:8], "return")
write_row.__annotations__ = dict(zip(_names, (*_KINDS, GenericAlias(tuple, (float,) * 9), Here), strict=True))
write_row = stage(write_row)


def row(k: Tick) -> tuple[Vector, Here]:
    """Return the log row of a tick in the order of `COLUMNS`, and `Here`. Columns reported by stages are NaN."""
    values, m = np.empty(len(COLUMNS)), k.measured
    others = m.quality, m.steer, m.pedal, k.z_ref, k.command.speed, k.steer_ref, k.pedal_ref, k.saturated, k.faults
    here = write_row(values, k.truth, m.fix or NO_FIX, held(k.estimate), k.reference, k.drive, k.actuation, others)
    return values, here


def table(wheels: bool, reported: Iterable[Column] = ()) -> tuple[Column, ...]:
    """Return the columns of a log: common signals, wheel signals if `wheels`, and signals `reported` by stages."""
    common = (*(signal.column for signal in SIGNALS), *(WHEEL_SIGNALS if wheels else ()))
    known = {column.name for column in common}
    return (*common, *(column for column in reported if column.name not in known))
