"""Sensor suite of the tractor: a new sensor needs a module and a field in `Sensors`.

The suite calls each of its sensors once per tick. Every reading is in `Measurement.readings` under the name of the
field; readings of the paper's sensors also have separate fields.
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
"""Sensor and field of the reading for each line that `Conditions` may distort; "" for scalar readings."""


class SensorState(NamedTuple):
    """State of all sensors between two ticks."""

    states: dict[str, Any]
    readings: dict[str, Any]
    """Last reading of each sensor; empty before the first tick."""
    present: tuple[str, ...] = ()
    """Names of the sensors to evaluate; empty before the first tick, in which all are evaluated."""
    lines: tuple[tuple[str, SignalLine], ...] = ()
    """Lines distorted in the last tick, by name; for other lines the last reading is the last value."""


class Sensors(Spec):
    """All sensors of the tractor; `[sensors]`."""

    gnss: Gnss = Gnss()
    """RTK-GNSS receiver."""
    steering_pot: SteeringPotentiometer = SteeringPotentiometer()
    """Potentiometer of the steering angle, on the front axle."""
    pedal_pot: PedalPotentiometer = PedalPotentiometer()
    """Potentiometer of the pedal position."""
    gyro: Gyro = Gyro()
    """Yaw rate gyro. Default: absent."""
    imu: Imu = Imu()
    """Inertial unit for roll and pitch. Default: absent."""
    wheel_speed: WheelSpeed = WheelSpeed()
    """Speed sensor of the driven wheels. Default: absent."""
    radar_speed: RadarSpeed = RadarSpeed()
    """Radar for the speed over ground. Default: absent."""
    implement_gnss: ImplementGnss = ImplementGnss()
    """GNSS receiver on the implement. Default: absent."""

    @property
    def all(self) -> dict[str, Sensor]:
        """All sensors by name, in the order of the fields."""
        return dict(self)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns that the sensors add to the log."""
        return tuple(column for sensor in self.all.values() for column in sensor.columns)

    def init(self, seed: int) -> SensorState:
        """Return the state before the first tick, with noise from the random streams of `seed`."""
        return SensorState({name: sensor.init(seed) for name, sensor in self.all.items()}, {})

    def measure(
        self, state: SensorState, truth: Truth, conditions: Conditions, dt: float
    ) -> tuple[SensorState, Measurement]:
        """Return the measurement available to the controllers in the tick of length `dt` [s] that ends at `truth.t`."""
        states, readings = state.states.copy(), state.readings.copy()
        for name in state.present or states:
            found = getattr(self, name).measure(states[name], truth, conditions, dt)
            states[name], readings[name] = check_pair(found, "its state and measurement", "the sensor", name, "measure")
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
        """Return the names of sensors that measure or report; other readings keep their value of the first tick."""
        return tuple(
            name for name, sensor in self.all.items() if getattr(sensor, "enabled", True) or len(sensor.columns)
        )

    def report(self, state: SensorState) -> tuple[float, ...]:
        """Return the values of `columns` after a tick."""
        return tuple([v for name in state.present for v in getattr(self, name).report(state.readings[name])])


def _distort(
    readings: dict[str, Any], last: SensorState, conditions: Conditions, dt: float
) -> tuple[tuple[str, SignalLine], ...]:
    """Write the values transmitted by distorted lines into `readings`; return the lines after a tick of `dt` [s]."""
    before, lines = dict(last.lines), []
    for name, (sensor, field) in LINES.items():
        if (distortion := getattr(conditions, name)) != SOUND:
            reading, earlier = readings[sensor], last.readings.get(sensor)
            line = before.get(name) or SignalLine(getattr(earlier, field, None) if field else earlier)
            line, value = line.carried(getattr(reading, field) if field else reading, distortion, dt)
            readings[sensor] = reading._replace(**{field: value}) if field else value
            lines.append((name, line))
    return tuple(lines)
