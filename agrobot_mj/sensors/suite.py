"""Sensor suite of the tractor; to add a sensor, write a module and add a field to `Sensors`.

The suite evaluates its sensors once per tick: the sensors of the package in one compiled call, and other sensors by
`measure`. `Measurement.readings` contains the measurements of all sensors by field name; the basic measurements also
have separate fields of `Measurement`.
"""

from functools import lru_cache
from math import nan
from typing import Any, NamedTuple, cast

import numpy as np

from agrobot_mj.core.contracts import check_pair
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held
from agrobot_mj.core.lines import SignalLine
from agrobot_mj.core.randomness import address, addresses
from agrobot_mj.core.signals import NOMINAL, SOUND, TICK_S, Column, Conditions, Fix, Measurement, Quality, Truth
from agrobot_mj.core.spec import Spec
from agrobot_mj.sensors.base import CompiledSensor, Sensor
from agrobot_mj.sensors.gnss import CLEAR, Delivery, Gnss, GnssReading, Streams
from agrobot_mj.sensors.gyro import Gyro
from agrobot_mj.sensors.implement_gnss import ImplementGnss
from agrobot_mj.sensors.imu import Imu
from agrobot_mj.sensors.potentiometer import PedalPotentiometer, SteeringPotentiometer
from agrobot_mj.sensors.sensing import Addresses, Generators, Laws, SensorReadings, Values, sense
from agrobot_mj.sensors.speed import RadarSpeed, WheelSpeed

LINES = {
    "steering_pot": ("steering_pot", ""),
    "pedal_pot": ("pedal_pot", ""),
    "gyro": ("gyro", ""),
    "wheel_speed": ("wheel_speed", ""),
    "imu_roll": ("imu", "roll"),
    "imu_pitch": ("imu", "pitch"),
}
"""Sensor name and measurement field (empty for plain numbers) of each signal line that faults can distort."""
NO_SAMPLES = np.zeros(0)  # Empty array, for which `sense` samples the true steering angle


class SensorState(NamedTuple):
    """State of all sensors between two ticks."""

    generators: Generators
    values: Held[Values]
    delivery: Delivery  # State of the GNSS receiver without its position errors
    states: dict[str, Any]  # States of the sensors that are not compiled
    readings: dict[str, Any]  # Last measurement of each sensor, or an empty mapping before the first tick
    lines: tuple[tuple[str, SignalLine], ...] = ()
    """State, by name, of each signal line distorted in the last tick. Other signal lines transmit values unchanged."""
    sound: bool = True  # Whether the numbers of the true state are finite


class Sensors(Spec):
    """All sensors of the tractor, configured by the tables of `[sensors]`."""

    gnss: Gnss = Gnss()
    """RTK-GNSS receiver."""
    steering_pot: SteeringPotentiometer = SteeringPotentiometer()
    """Potentiometer that measures the steering angle at the front axle."""
    pedal_pot: PedalPotentiometer = PedalPotentiometer()
    """Potentiometer that measures the pedal position."""
    gyro: Gyro = Gyro()
    """Yaw-rate gyro. Default: absent."""
    imu: Imu = Imu()
    """Inertial unit for roll and pitch. Default: absent."""
    wheel_speed: WheelSpeed = WheelSpeed()
    """Speed sensor of the driven wheels. Default: absent."""
    radar_speed: RadarSpeed = RadarSpeed()
    """Doppler radar for the speed over ground. Default: absent."""
    implement_gnss: ImplementGnss = ImplementGnss()
    """GNSS receiver on the implement. Default: absent."""

    @property
    def all(self) -> dict[str, Sensor]:
        """All sensors by name, in the order of the fields."""
        return dict(self)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of all sensors."""
        return tuple(column for sensor in self.all.values() for column in sensor.columns)

    def init(self, seed: int) -> SensorState:
        """Return the state before the first tick; `seed` determines the random streams of the sensors."""
        compiled, others = _split_by_stage(self)
        states: dict[str, Any] = {name: sensor.init(seed) for name, sensor in compiled.items()}
        gnss, steering_pot, pedal_pot = states["gnss"], states["steering_pot"], states["pedal_pot"]
        noises = {"gnss": gnss.noise, **{name: states[name] for name in NOISY}}
        generators = {name: noise.generators for name, noise in noises.items()}
        return SensorState(
            Generators(steering_pot, pedal_pot, **generators),
            held(Values(**{name: noise.values for name, noise in noises.items()})),
            gnss.delivery,
            {name: sensor.init(seed) for name, sensor in others.items()},
            {},
        )

    def measure(
        self, state: SensorState, truth: Truth, conditions: Conditions, dt: float
    ) -> tuple[SensorState, Measurement]:
        """Return the new state, and the measurements for the controllers at the end of a tick of `dt` [s]."""
        suite = _suite(self, dt)
        suite.prepare(len(truth.steer_samples))
        return suite.measure(state, held(truth), conditions)

    def report(self, state: SensorState) -> tuple[float, ...]:
        """Return the values of the log columns of all sensors after a tick."""
        return _suite(self, TICK_S).report(state)


NOISY = Values._fields[1:]  # Names of the compiled sensors that may be absent
KINDS = {name: type(getattr(Sensors(), name)) for name in Generators._fields}  # Classes of the compiled sensors by name


def _split_by_stage(sensors: Sensors) -> tuple[dict[str, Any], dict[str, Sensor]]:
    """Return the sensors evaluated in the compiled call, and the sensors evaluated by their method `measure`.

    A sensor whose class overrides `measure` or `seen` belongs to the second group. A sensor with default settings then
    takes its place in the first group.
    """
    every = sensors.all
    compiled = {k: every[k] if _methods(type(every[k])) == _methods(kind) else kind() for k, kind in KINDS.items()}
    return compiled, {name: sensor for name, sensor in every.items() if compiled.get(name) is not sensor}


def _methods(kind: type) -> list[Any]:
    return [getattr(kind, name, None) for name in ("measure", "seen")]


class Suite:
    """Sensors of a run, with parameters prepared for the compiled function `sense`."""

    def __init__(self, sensors: Sensors, dt: float) -> None:
        """Prepare the sensors for ticks of length `dt` [s]."""
        self.columns, self.dt = sensors.columns, dt
        compiled, self.others = _split_by_stage(sensors)
        self.compiled: dict[str, Any] = compiled
        self.gnss, self.steering_pot, self.pedal_pot = compiled["gnss"], compiled["steering_pot"], compiled["pedal_pot"]
        self._prepared: tuple[int, Any] = 0, None
        """Cached number of physics steps per tick, and the parameters of `sense` for this number."""
        self.plain = not self.others and self.gnss.immediate and self.steering_pot.linear
        """Whether the compiled function delivers all measurements in ticks without faults."""
        self.compiled_only = all(type(sensor) is KINDS[name] for name, sensor in compiled.items())
        """Whether no sensor belongs to a subclass, which may change its log columns."""
        self._streams: tuple[Generators, Addresses] | None = None
        """Random streams and their addresses, or None before the first tick."""
        self.absent = {name: self.compiled[name].absent for name in NOISY if not self.compiled[name].enabled}
        self.present = {
            name: sensor
            for name, sensor in self.others.items()
            if getattr(sensor, "enabled", True) or len(sensor.columns)
        }
        """Sensors without a compiled law that are present; absent sensors are evaluated only in the first tick."""
        self._reporting = [(name, sensor.report) for name, sensor in sensors.all.items() if len(sensor.columns)]

    def measure(
        self, state: SensorState, truth: Held[Truth], conditions: Conditions
    ) -> tuple[SensorState, Measurement]:
        """Return the new state and the measurement at the end of a tick with the true state `truth`."""
        now, plain = truth, conditions is NOMINAL and self.plain
        if not (plain and self._prepared[0]):
            now = fetched(truth)
            self.prepare(len(now.steer_samples))
        delivery, sky = (state.delivery, CLEAR) if plain else self.gnss.sky(state.delivery, now, conditions, self.dt)
        steer = NO_SAMPLES if plain else np.ascontiguousarray(self.steering_pot.seen(now))
        streams = self._addresses(state.generators)
        values, found, sound = sense(self._prepared[1], state.values, streams, truth, sky, steer)
        if plain and not delivery.pending:
            return self.immediate(state, values, found, sound)
        delivery, gnss = self.gnss.deliver(delivery, Fix(*found.gnss), found.heading, sky.quality, conditions, self.dt)
        readings = self._readings(found, gnss)
        states = state.states if plain or not self.others else self._measure_others(state, readings, now, conditions)
        lines = () if conditions is NOMINAL else _distort(readings, state, conditions, self.dt)
        t = delivery.last.t if plain and delivery.last else now.t
        after = SensorState(state.generators, values, delivery, states, readings, lines, sound)
        return after, _measurement(t, readings)

    def immediate(
        self, state: SensorState, values: Held[Values], found: SensorReadings, sound: bool
    ) -> tuple[SensorState, Measurement]:
        """Return new state and measurement of a tick from the results of `sense`, if no fault is active, the GNSS has
        no latency, and all sensors are computed by `sense`."""
        (canopies, line, _, _), measured = state.delivery, self.measurement(found)
        if self.gnss.dual_antenna.enabled:
            line = SignalLine(found.heading)
        delivery, readings = Delivery(canopies, line, (), measured.fix), cast(dict[str, Any], measured.readings)
        after = SensorState(state.generators, values, delivery, state.states, readings, state.lines[:0], sound)
        return after, measured

    def measurement(self, found: SensorReadings) -> Measurement:
        """Return the measurement of a tick from the results of `sense`, if no fault is active and the GNSS has no
        latency."""
        heading = wrap(found.heading) if self.gnss.dual_antenna.enabled else nan
        return _measurement(found.gnss[4], self._readings(found, GnssReading(Fix(*found.gnss, heading), Quality.FIX)))

    def _readings(self, found: SensorReadings, gnss: GnssReading) -> dict[str, Any]:
        """Return the measurements by sensor name; `gnss` is the GNSS solution delivered in this tick."""
        _, _, steer_angle, pedal_place, gyro, imu, wheels, radar, implement = found
        return {
            "gnss": gnss,
            "steering_pot": steer_angle,
            "pedal_pot": pedal_place,
            "gyro": gyro,
            "imu": imu,
            "wheel_speed": wheels,
            "radar_speed": radar,
            "implement_gnss": implement,
            **self.absent,
        }

    def report(self, state: SensorState) -> tuple[float, ...]:
        """Return the values of the log columns of all sensors after a tick."""
        readings = state.readings
        values: list[float] = []
        for name, report in self._reporting:
            values += report(readings[name])
        return tuple(values)

    def prepare(self, steps: int) -> None:
        """Compute the parameters of `sense` for ticks with `steps` physics steps."""
        if steps != self._prepared[0]:
            noisy: dict[str, CompiledSensor] = {name: self.compiled[name] for name in NOISY}
            present: Any = tuple(sensor.enabled for sensor in noisy.values())
            pots = self.steering_pot.parameters(steps), self.pedal_pot.parameters(steps)
            laws = {name: sensor.parameters(self.dt) for name, sensor in noisy.items()}
            self._prepared = steps, held(Laws(*pots, present, self.gnss.parameters(self.dt), **laws))

    def compiled_form(self, generators: Generators, steps: int) -> tuple[Held[Laws], Held[Addresses]]:
        """Return parameters of `sense` for `steps` physics steps per tick, and addresses of the random streams."""
        self.prepare(steps)
        return self._prepared[1], self._addresses(generators)

    def readings_of(self, m: Measurement, heading: float | None) -> SensorReadings:
        """Return a measurement that contains a fix as `SensorReadings`. `heading` is the two-antenna heading before
        wrapping."""
        fix, other = cast(Fix, m.fix), m.readings
        return SensorReadings(
            gnss=fix[:6],
            heading=nan if heading is None else heading,
            steering_pot=m.steer,
            pedal_pot=m.pedal,
            gyro=m.gyro,
            imu=other["imu"]._replace(roll=m.roll, pitch=m.pitch),
            wheel_speed=m.wheel_speed,
            radar_speed=other["radar_speed"],
            implement_gnss=other["implement_gnss"],
        )

    def _addresses(self, generators: Generators) -> Held[Addresses]:
        """Return the addresses of the random streams of all compiled sensors."""
        known = self._streams
        if known is None or known[0] is not generators:
            pots, others = map(address, generators[:2]), map(addresses, generators[3:])
            found = Addresses._make((*pots, Streams(*addresses(generators.gnss)), *others))
            self._streams = known = generators, held(found)
        return known[1]

    def _measure_others(
        self, state: SensorState, readings: dict[str, Any], truth: Truth, conditions: Conditions
    ) -> dict[str, Any]:
        """Evaluate the sensors that are not compiled: add their measurements to `readings`, and return their states."""
        states = state.states.copy()
        if state.readings:
            readings |= {name: state.readings[name] for name in self.others}
        for name, sensor in (self.present if state.readings else self.others).items():
            found = sensor.measure(states[name], truth, conditions, self.dt)
            states[name], readings[name] = check_pair(found, "its state and measurement", "the sensor", name, "measure")
        return states


def _measurement(t: float, readings: dict[str, Any]) -> Measurement:
    imu, gnss, steer, pedal = readings["imu"], readings["gnss"], readings["steering_pot"], readings["pedal_pot"]
    rest = readings["gyro"], imu.roll, imu.pitch, readings["wheel_speed"], readings
    return Measurement(t, gnss.fix, gnss.quality, steer, pedal, *rest)


@lru_cache(maxsize=8)
def _suite(sensors: Sensors, dt: float) -> Suite:
    return Suite(sensors, dt)


def _distort(
    readings: dict[str, Any], last: SensorState, conditions: Conditions, dt: float
) -> tuple[tuple[str, SignalLine], ...]:
    """Replace the values in `readings` that distorted signal lines transmit; return the states of these lines."""
    before, lines = dict(last.lines), []
    for name, (sensor, field) in LINES.items():
        if (distortion := getattr(conditions, name)) != SOUND:
            reading, earlier = readings[sensor], last.readings.get(sensor)
            line = before.get(name) or SignalLine(getattr(earlier, field, None) if field else earlier)
            line, value = line.transmit(getattr(reading, field) if field else reading, distortion, dt)
            readings[sensor] = reading._replace(**{field: value}) if field else value
            lines.append((name, line))
    return tuple(lines)
