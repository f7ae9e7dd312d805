"""Base classes of sensors, which compute a measurement from the true state once per tick.

A sensor is an immutable object with keys under `[sensors.<name>]` and the methods `init(seed) -> state` and
`measure(state, truth, conditions, dt) -> (state, reading)`. The reading (measurement) is a float or a NamedTuple in SI
units and radians. Random numbers come from `randomness.stream` under the name of the sensor. A sensor uses the same
number of random samples in each tick under all conditions, so that faults do not change its noise. `columns` and
`report` log the measurement.

Each sensor of the package has a compiled law (measurement function), and the suite evaluates all laws in one compiled
call. The parameters of a law are the keys of the sensor as a named tuple of numbers.
"""

from collections.abc import Callable
from math import nan
from typing import Any, ClassVar, NamedTuple

from numpy.random import Generator

from agrobot_mj.core.kernels import shared
from agrobot_mj.core.randomness import addresses
from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.vectors import Vector


class SensedMotion(NamedTuple):
    """Quantities of the true state that the compiled sensors measure. `Truth` describes the fields."""

    t: float
    yaw: float
    pitch: float
    roll: float
    speed: float
    yaw_rate: float
    antenna: Vector
    antenna_velocity: Vector
    wheel_speed: float
    body_rates: Vector
    rear_velocity: Vector
    implement: tuple[float, float]


@shared
def motion_of(truth: Truth) -> SensedMotion:
    """Return the quantities of the true state that the compiled sensors measure."""
    t = truth
    return SensedMotion(
        t.t, t.yaw, t.pitch, t.roll, t.speed, t.yaw_rate, t.antenna, t.antenna_velocity, t.wheel_speed, t.body_rates,
        t.rear_velocity, t.implement,
    )  # fmt: skip


class Noise(NamedTuple):
    """State of a compiled sensor between two ticks: random streams and numeric values."""

    generators: tuple[Generator, ...]  # Random streams, advanced in place
    values: Any  # Named tuple of the numbers that change in each tick


class Sensor(Reporting):
    """Base class of all sensors. Subclasses define `init` and `measure`, and `columns` and `report` for the log."""

    def init(self, seed: int) -> Any:
        """Return the state before the first tick of a run with this `seed`."""
        raise NotImplementedError

    def measure(self, state: Any, truth: Truth, conditions: Conditions, dt: float) -> tuple[Any, Any]:
        """Return the new state and the measurement at time `truth.t`, the end of a tick of `dt` [s]."""
        raise NotImplementedError


class CompiledSensor(Sensor):
    """Base class of the optional sensors with a compiled law (measurement function)."""

    law: ClassVar[Callable[..., tuple[Any, Any]]]
    """Compiled measurement function.

    The arguments are the parameters, the numeric state of the sensor, the addresses of its random streams, and the
    motion of the tractor. The results are the new numeric state and the measurement.
    """
    absent: ClassVar[Any] = nan
    """Measurement returned if the tractor does not have the sensor, usually NaN."""

    enabled: bool = False
    """Whether the sensor is present."""

    def parameters(self, dt: float) -> Any:
        """Return the parameters of `law` for ticks of length `dt` [s]."""
        raise NotImplementedError

    def measure(self, state: Noise, truth: Truth, conditions: Conditions, dt: float) -> tuple[Noise, Any]:
        """Return the new state and the measurement at time `truth.t`, the end of a tick of `dt` [s]."""
        if not self.enabled:
            return state, self.absent
        law = type(self).law
        values, reading = law(self.parameters(dt), state.values, addresses(state.generators), motion_of(truth))
        return state._replace(values=values), reading


class OptionalSensor(Sensor):
    """Base class of optional sensors with a scalar measurement, which the tractor of [Kayacan2015] does not have."""

    column: ClassVar[Column]
    """Log column of the measurement."""

    enabled: bool = False
    """Whether the sensor is present; otherwise the measurement is NaN."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log column of the measurement, or an empty tuple if the sensor is absent."""
        return (self.column,) if self.enabled else ()

    def report(self, reading: float) -> tuple[float, ...]:
        """Return the measurement as the value of the log column, or an empty tuple if the sensor is absent."""
        return (reading,) if self.enabled else ()
