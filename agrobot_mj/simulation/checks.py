"""Messages are checked where they are received: a number that is not finite is an error of the stage that made it.

One sum of a message's numbers tells whether all are finite; only then are they looked at one by one. What a real
computer would reject - a fix or a reading that is no number - counts as missing instead, see `Screen`.
"""

from collections.abc import Sequence
from math import degrees, inf, isfinite, nan, radians
from typing import Any, NamedTuple, NoReturn

import numpy as np

from agrobot_mj.core.answers import told
from agrobot_mj.core.errors import NotFiniteError, ScenarioError
from agrobot_mj.core.signals import (
    Column,
    Command,
    Conditions,
    Distortion,
    Drive,
    Estimate,
    Fix,
    Measurement,
    Quality,
    Reference,
    Truth,
)
from agrobot_mj.faults.base import Scripted

FARTHEST_M, FASTEST_M_S = 1e7, 1e3
"""A fix farther from the origin, or faster, is nonsense [m, m/s]: a quarter of the equator, three times sound."""
ABSURD_STEER = radians(90.0)
"""Steering angle that no law means [rad]: the wheels across the tractor."""
OPTIONAL = ("gyro", "roll", "pitch", "wheel_speed")
"""Readings that are NaN where there is no sensor."""
ARITHMETIC = (ArithmeticError, ValueError, np.linalg.LinAlgError)
"""Errors that numbers which are not finite give rise to, among others."""
_ARITHMETIC = ("math domain error", "infs or NaNs", "cannot convert float")
"""Parts of messages of ValueError that only numbers which are not finite give rise to."""


class Screen(NamedTuple):
    """What passed of the measurements so far."""

    steer: float = 0.0
    """Last steering angle that was a number [rad]."""
    pedal: float = 0.0
    """Last pedal position that was a number [-]."""
    rejected: tuple[tuple[str, int], ...] = ()
    """How often each reading was rejected, by field."""

    def passed(self, measured: Measurement, truth: Truth, plant: str) -> "tuple[Screen, Measurement]":
        """The measurement without what is no number: a fix becomes a missing one, an angle keeps its last value.

        Raises `NotFiniteError` where that comes from the plant.
        """
        fix = measured.fix
        optional = measured.gyro, measured.roll, measured.pitch, measured.wheel_speed
        sound = fix is None or _possible(fix)
        if sound and isfinite(measured.steer + measured.pedal) and inf not in map(abs, optional):
            return Screen(measured.steer, measured.pedal, self.rejected), measured
        check_truth(truth, plant, samples=True)
        bad = [] if sound else ["fix"]
        changes: dict[str, Any] = {} if sound else {"fix": None, "quality": Quality.NONE}
        for name, last in (("steer", self.steer), ("pedal", self.pedal)):
            if not isfinite(getattr(measured, name)):
                changes[name] = last
        changes |= {name: nan for name, value in zip(OPTIONAL, optional, strict=True) if abs(value) == inf}
        bad += [name for name in changes if name not in ("fix", "quality")]
        counts = dict(self.rejected)
        counts |= {name: counts.get(name, 0) + 1 for name in bad}
        measured = measured._replace(**changes)
        return Screen(measured.steer, measured.pedal, tuple(counts.items())), measured


def _possible(fix: Fix) -> bool:
    """Whether a fix lies on the earth; false for NaN."""
    sound = inf not in (abs(fix.z), abs(fix.heading))  # NaN stands for "not told"
    return sound and abs(fix.x) + abs(fix.y) < FARTHEST_M and abs(fix.vx) + abs(fix.vy) < FASTEST_M_S


def check_truth(truth: Truth, plant: str, samples: bool = False) -> None:
    """Raise `NotFiniteError` if the plant's state is not finite; its samples are looked at when asked for."""
    if not isfinite(sum(truth[:14]) + sum(truth.antenna) + sum(truth.antenna_velocity)):
        refuse("truth", truth, Truth._fields[:16], f"the plant ({plant})")
    if samples and not (np.isfinite(truth.steer_samples).all() and np.isfinite(truth.pedal_samples).all()):
        refuse("truth", truth, Truth._fields[16:18], f"the plant ({plant})")


def check_estimate(estimate: Estimate, estimator: str) -> None:
    """Raise `NotFiniteError` if the estimate is not finite."""
    try:
        finite = isfinite(sum(estimate[:7]) + sum(estimate.covariance.ravel().tolist()))
    except (AttributeError, TypeError, ValueError):
        raise ScenarioError(f"the estimator ({estimator}) estimates what is no number: {told(estimate)}") from None
    if not finite:
        refuse("estimate", estimate, Estimate._fields[:8], f"the estimator ({estimator})")


def read_only(estimate: Estimate) -> Estimate:
    """The estimate for those who may only look at it: its covariance is the filter's own array."""
    covariance = estimate.covariance.view()
    covariance.flags.writeable = False
    return estimate._replace(covariance=covariance)


def check_conditions(conditions: Conditions, faults: Sequence[Scripted]) -> None:
    """Raise `NotFiniteError`, naming the kinds, if faults make conditions that are not finite."""
    c = conditions
    wheels = (*c.tyre_stiffness, *c.tyre_rolling)
    forces = c.valve_gain + c.valve_dead_band + c.drawbar + c.side_force + c.grip
    lines = {name: value for name, value in c._asdict().items() if isinstance(value, Distortion)}
    kinds = f"a fault ({', '.join(fault.kind for fault in faults)})"
    for name, line in lines.items():
        if not isfinite(line.scale + line.offset + line.delay_s):
            refuse(f"conditions.{name}", line, Distortion._fields[:3], kinds)
    if not isfinite(c.gnss_quality + c.gnss_latency_s + sum(c.gnss_offset) + forces + sum(wheels)):
        refuse("conditions", c, tuple(n for n in c._fields if n not in ("payload", "gnss_frozen", *lines)), kinds)


def check_reference(reference: Reference, path: str) -> None:
    """Raise `NotFiniteError` if the reference is not finite."""
    if not isfinite(sum(reference)):
        refuse("reference", reference, Reference._fields, f"the path ({path})")


def check_command(command: Command, guidance: str) -> None:
    """Raise `NotFiniteError` if a command is not finite or its angle absurd, `ScenarioError` if it holds no numbers."""
    try:
        finite = isfinite(command.steer + command.speed + (command.steer_voltage or 0.0) + (command.pedal or 0.0))
    except (TypeError, ValueError):
        raise ScenarioError(f"the guidance law ({guidance}) commands what is no number: {told(command)}") from None
    if not finite:
        refuse("command", command, Command._fields, f"the guidance law ({guidance})")
    if abs(command.steer) > ABSURD_STEER:
        angle = f"{degrees(command.steer):.4g} deg, beyond a right angle"
        raise NotFiniteError(f"command.steer is {angle}, made by the guidance law ({guidance}); it is in radians")


def limited(command: Command, steer_limit: float) -> Command:
    """The command with its angle within the limit of the steering [rad]: what a computer lets through to its loop."""
    if -steer_limit <= command.steer <= steer_limit:
        return command
    return command._replace(steer=min(max(command.steer, -steer_limit), steer_limit))


def check_report(stage: str, kind: str, columns: Sequence[Column], report: Any) -> None:
    """Raise `ScenarioError` if what a stage reports is not one number for each of its columns."""
    try:
        numbers = [float(value) for value in report]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != len(columns):
        count = f"{len(columns)} numbers, one for each of its columns"
        raise ScenarioError(f"{stage} ({kind}): report must return {count}, got {told(report)}")


def check_drive(drive: Drive) -> None:
    """Raise `NotFiniteError` if a valve's voltage is not finite."""
    if not isfinite(drive.steer_voltage + drive.pedal_voltage):
        refuse("drive", drive, Drive._fields, "the low-level loops (steering.loop, speed)")


def refuse(name: str, message: NamedTuple, fields: tuple[str, ...], maker: str) -> NoReturn:
    """Raise the `NotFiniteError` that names the first of these fields that is not finite, and who made it."""
    for field in fields:
        value = getattr(message, field)
        if value is not None and not np.isfinite(value).all():
            shown = np.ravel(value)
            raise NotFiniteError(f"{name}.{field} is {shown[~np.isfinite(shown)][0]}, made by {maker}")
    raise NotFiniteError(f"{name} is beyond the numbers that a computer has, made by {maker}")


def blame(stage: str, error: Exception) -> NoReturn:
    """Raise an error of arithmetic as a `NotFiniteError` that names the stage; any other as it is."""
    numbers = not isinstance(error, ValueError) or isinstance(error, np.linalg.LinAlgError)
    if not numbers and not any(part in str(error) for part in _ARITHMETIC):
        raise error
    if isinstance(error, NotFiniteError):
        raise error
    raise NotFiniteError(f"{stage} failed: {error}") from error
