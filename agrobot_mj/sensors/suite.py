"""All sensors of the tractor: a new sensor is a file and a line in `Sensors`.

The suite calls each of its fields once per tick. Every measurement is in `Measurement.readings` under the name of the
field; those of the paper's stack also have separate fields.
"""

from typing import Any, NamedTuple

from agrobot_mj.core.contracts import check_pair
from agrobot_mj.core.lines import SignalLine
from agrobot_mj.core.signals import NOMINAL, SOUND, Column, Conditions, Measurement, Truth
from agrobot_mj.core.spec import Spec
from agrobot_mj.sensors.base import Sensor
from agrobot_mj.sensors.gnss import Gnss
from agrobot_mj.sensors.gyro import Gyro
from agrobot_mj.sensors.implement_gnss import ImplementGnss
from agrobot_mj.sensors.imu import Imu
from agrobot_mj.sensors.potentiometer import PedalPotentiometer, SteeringPotentiometer
from agrobot_mj.sensors.speed import RadarSpeed, WheelSpeed

LINES = {
    "steering_pot": ("steering_pot", ""),
    "pedal_pot": ("pedal_pot", ""),
    "gyro": ("gyro", ""),
    "wheel_speed": ("wheel_speed", ""),
    "imu_roll": ("imu", "roll"),
    "imu_pitch": ("imu", "pitch"),
}
"""Lines that `Conditions` may distort, by their names there: the sensor, and the field of a reading with several."""


class SensorState(NamedTuple):
    """The sensors between two ticks, by name."""

    states: dict[str, Any]
    readings: dict[str, Any]
    """Last reading of each sensor, empty before the first tick."""
    present: tuple[str, ...] = ()
    """Names of the sensors that are there; empty before the first tick, in which all are asked."""
    lines: tuple[tuple[str, SignalLine], ...] = ()
    """Lines distorted in the last tick, by name; other lines contain the last measurement."""


class Sensors(Spec):
    """All sensors of the tractor; `[sensors]`."""

    gnss: Gnss = Gnss()
    """RTK-GNSS receiver."""
    steering_pot: SteeringPotentiometer = SteeringPotentiometer()
    """Angle of the bicycle's virtual wheel, on the front axle."""
    pedal_pot: PedalPotentiometer = PedalPotentiometer()
    """Position of the pedal."""
    gyro: Gyro = Gyro()
    """Yaw rate, off by default."""
    imu: Imu = Imu()
    """Roll and pitch, off by default."""
    wheel_speed: WheelSpeed = WheelSpeed()
    """Speed of the driven wheels, off by default."""
    radar_speed: RadarSpeed = RadarSpeed()
    """Speed over ground, off by default."""
    implement_gnss: ImplementGnss = ImplementGnss()
    """A second receiver, on the implement, off by default."""

    @property
    def all(self) -> dict[str, Sensor]:
        """The sensors by name, in the order of the fields."""
        return dict(self)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns that the sensors add to the log."""
        return tuple(column for sensor in self.all.values() for column in sensor.columns)

    def init(self, seed: int) -> SensorState:
        """Return the sensors at rest, their noise drawn from the named streams of `seed`."""
        return SensorState({name: sensor.init(seed) for name, sensor in self.all.items()}, {})

    def measure(
        self, state: SensorState, truth: Truth, conditions: Conditions, dt: float
    ) -> tuple[SensorState, Measurement]:
        """Return the measurement that reaches the controller in the tick of length `dt` [s] that ends at `truth.t`."""
        states, readings = state.states.copy(), state.readings.copy()
        for name in state.present or states:
            found = getattr(self, name).measure(states[name], truth, conditions, dt)
            states[name], readings[name] = check_pair(found, "its state and a reading", "the sensor", name, "measure")
        lines = () if conditions is NOMINAL else _distort(readings, state, conditions, dt)
        gnss, imu = readings["gnss"], readings["imu"]
        measurement = Measurement(
            t=truth.t,
            fix=gnss.fix,
            quality=gnss.quality,
            steer=readings["steering_pot"],
            pedal=readings["pedal_pot"],
            gyro=readings["gyro"],
            roll=imu.roll,
            pitch=imu.pitch,
            wheel_speed=readings["wheel_speed"],
            readings=readings,
        )
        return SensorState(states, readings, state.present or self._present(), lines), measurement

    def _present(self) -> tuple[str, ...]:
        """Return the names of the sensors that measure or report; other measurements keep the value of the first
        tick."""
        return tuple(
            name for name, sensor in self.all.items() if getattr(sensor, "enabled", True) or len(sensor.columns)
        )

    def report(self, state: SensorState) -> tuple[float, ...]:
        """Return the values of `columns` after a tick."""
        return tuple([v for name in state.present for v in getattr(self, name).report(state.readings[name])])


def _distort(
    readings: dict[str, Any], last: SensorState, conditions: Conditions, dt: float
) -> tuple[tuple[str, SignalLine], ...]:
    """Write the values that arrive over distorted lines into `readings`; return the lines after a tick of `dt` [s]."""
    before, lines = dict(last.lines), []
    for name, (sensor, field) in LINES.items():
        if (distortion := getattr(conditions, name)) != SOUND:
            reading, earlier = readings[sensor], last.readings.get(sensor)
            line = before.get(name) or SignalLine(getattr(earlier, field, None) if field else earlier)
            line, value = line.carried(getattr(reading, field) if field else reading, distortion, dt)
            readings[sensor] = reading._replace(**{field: value}) if field else value
            lines.append((name, line))
    return tuple(lines)
