"""Faults of the signal line from a sensor or to a valve. The module `core.lines` computes the distorted signal.

The name of a fault consists of the line, which is a field of `Conditions`, and the effect, as in `gyro_stuck`. Stuck,
scaled, delayed and lost signals have the same definition for all lines. An offset has the unit of its line.
"""

from math import radians
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from agrobot_mj.core.signals import Conditions, Distortion
from agrobot_mj.core.spec import Latency, NonNegative
from agrobot_mj.faults.base import Scripted


class LineFault(Scripted):
    """Base class of the faults of one signal line. Subclasses override `apply` and call `distort`."""

    signals: ClassVar = {
        "steering_pot": "measured steering angle",
        "pedal_pot": "measured pedal position",
        "gyro": "yaw rate of the gyro",
        "wheel_speed": "speed of the wheels",
        "heading": "heading from two antennas",
        "imu_roll": "roll of the inertial unit",
        "imu_pitch": "pitch of the inertial unit",
        "valve": "voltage of the steering valve",
        "pedal_valve": "voltage of the pedal valve",
    }
    """Description of the signal on each signal line, displayed in lists of faults."""

    @property
    def line(self) -> str:
        """Name of the field of `Conditions` that contains the distortion of the affected signal line."""
        return self.kind.rpartition("_")[0]

    def distortion(self, conditions: Conditions) -> Distortion:
        """Return the distortion of the affected signal line by the faults already applied in this tick."""
        found: Distortion = getattr(conditions, self.line)
        return found

    def distort(self, conditions: Conditions, **changes: Any) -> Conditions:
        """Return `conditions` with `changes` to the fields of the `Distortion` of the affected line."""
        changed: dict[str, Any] = {self.line: self.distortion(conditions)._replace(**changes)}
        return conditions._replace(**changed)


class Scaled(LineFault):
    """Scaled signal, caused by a wrong parameter, a shunt, a different tyre size or reversed wires (negative scale).

    The scale multiplies a measurement, or the valve voltage relative to neutral.
    """

    kind: Literal[
        "steering_pot_scale",
        "pedal_pot_scale",
        "gyro_scale",
        "wheel_speed_scale",
        "imu_roll_scale",
        "imu_pitch_scale",
        "valve_scale",
        "pedal_valve_scale",
    ]
    scale: Annotated[float, Field(ge=-10, le=10)] = -1.0
    """Signal divided by the true value [-]. Assumed value: -1 for a reversed sign, 0.5-2 for a wrong parameter."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Multiply the signal on the affected line by `scale`."""
        return None, self.distort(conditions, scale=self.scale * self.distortion(conditions).scale)


class Stuck(LineFault):
    """Stuck signal, at its last value or at zero, caused by a frozen bus message, a broken shaft or a jammed spool.

    If the line is stuck from the start of a run, it repeats the first value. A valve with a stuck line keeps its spool
    position; a valve stuck at zero has no flow.
    """

    kind: Literal[
        "steering_pot_stuck",
        "pedal_pot_stuck",
        "gyro_stuck",
        "wheel_speed_stuck",
        "heading_stuck",
        "imu_roll_stuck",
        "imu_pitch_stuck",
        "valve_stuck",
        "pedal_valve_stuck",
    ]
    value: Literal["last", "zero"] = "last"
    """Value of the stuck signal: its `last` value or `zero`."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Freeze the signal on the affected line at its last value or at zero."""
        return None, self.distort(conditions, stuck=self.value)


class Delayed(LineFault):
    """Delayed signal, caused by a loaded bus, a filter, cold oil or a sticking pilot valve.

    At the start of the fault the line repeats its last value for the duration of the delay.
    """

    kind: Literal[
        "steering_pot_delay", "gyro_delay", "wheel_speed_delay", "heading_delay", "valve_delay", "pedal_valve_delay"
    ]
    delay_s: Latency = 0.5
    """Additional delay of the signal [s], in whole ticks. Assumed value (range 0.2-1 for cold oil or a loaded bus,
    0.05-0.3 for a filter)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Add the delay to the signal on the affected line."""
        return None, self.distort(conditions, delay_s=self.distortion(conditions).delay_s + self.delay_s)


class Lost(LineFault):
    """Missing signal, caused by a cut wire or a sensor without power; the tractor's computer detects the loss.

    If the heading from two antennas is missing, the position remains valid. Recordings contain 758 losses of heading in
    motion, with a median duration of 0.2 s, a 95th percentile of 0.8 s, and a maximum of 3.4 s [Jones2026].
    """

    kind: Literal["heading_loss", "gyro_loss", "wheel_speed_loss", "imu_roll_loss", "imu_pitch_loss"]

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Mark the signal on the affected line as lost, so that the measurement is missing."""
        return None, self.distort(conditions, lost=True)


class Bias(LineFault):
    """Base class of measurement offsets. Each subclass has a key `bias` with a suffix for the unit, if any."""

    ramp_s: NonNegative = 0.0
    """Time over which the offset grows linearly from zero [s], or 0 for an immediate offset."""

    @property
    def offset(self) -> float:
        """Offset of the measurement after the end of the ramp, in SI units."""
        name = next(name for name in type(self).model_fields if name.startswith("bias"))
        value: float = getattr(self, name)
        return radians(value) if name.startswith("bias_deg") else value

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Add the offset, which may still be growing, to the measurement."""
        offset = self.distortion(conditions).offset + self.offset * self.strength_at(t, self.ramp_s)
        return None, self.distort(conditions, offset=offset)


class SteeringPotBias(Bias):
    """Offset of the measured steering angle."""

    kind: Literal["steering_pot_bias"] = "steering_pot_bias"
    bias_deg: Annotated[float, Field(ge=-90, le=90)] = 2.0
    """Offset of the measurement [deg], positive to the left. Assumed value (range 1-5 for a slipped clamp)."""


class PedalPotBias(Bias):
    """Offset of the measured pedal position."""

    kind: Literal["pedal_pot_bias"] = "pedal_pot_bias"
    bias: Annotated[float, Field(ge=-2, le=2)] = 0.1
    """Offset of the measurement [-], positive forward. Assumed value (range 0.05-0.2 for a slipped clamp)."""


class GyroBias(Bias):
    """Offset of the measured yaw rate."""

    kind: Literal["gyro_bias"] = "gyro_bias"
    bias_deg_s: Annotated[float, Field(ge=-1000, le=1000)] = 5.0
    """Offset of the measurement [deg/s], positive to the left. Assumed value (range 2-20 after a shock or at low supply
    voltage)."""


class AttitudeBias(Bias):
    """Offset of the measured signal, caused by an accelerometer during warm-up or a displaced bracket.

    With a ramp the offset increases over time, like a drift.
    """

    kind: Literal["imu_roll_bias", "imu_pitch_bias"]
    bias_deg: Annotated[float, Field(ge=-90, le=90)] = 5.0
    """Offset of the angle [deg], positive for left side up or nose down. Assumed value (range 1-10 for a displaced
    bracket)."""


class HeadingBias(Bias):
    """Offset of the heading from two antennas, caused by wrongly fixed ambiguities or a displaced antenna."""

    kind: Literal["heading_bias"] = "heading_bias"
    bias_deg: Annotated[float, Field(ge=-180, le=180)] = 10.0
    """Offset of the heading [deg], positive to the left. Assumed value (range 5-180); one wavelength across the
    baseline causes 11 deg."""
