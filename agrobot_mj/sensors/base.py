"""Base classes of sensors, which compute a measurement from the true state once per tick.

A sensor is frozen data with keys under `[sensors.<name>]`. It has the methods `init(seed) -> state` and `measure(state,
truth, conditions, dt) -> (state, reading)`; the reading is a float or a NamedTuple in SI units and radians. Random
numbers come from `randomness.stream` under the name of the sensor. Each tick draws the same number of samples under all
conditions, so that no sensor changes the noise of another. `columns` and `report` log a reading.

The sensors of the package have a compiled law in the file of their keys, and the suite evaluates all of them in one
compiled call. The parameters of a law are its keys as a named tuple of numbers.
"""

from collections.abc import Callable
from math import nan
from operator import attrgetter
from typing import Any, ClassVar, NamedTuple

from numpy.random import Generator

from agrobot_mj.core.randomness import address
from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.vectors import Vector


class SensedMotion(NamedTuple):
    """Part of the true state that compiled sensors measure; the fields are those of `Truth`."""

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


_motion = attrgetter(*SensedMotion._fields)


def motion_of(truth: Truth) -> SensedMotion:
    """Return the part of the true state that compiled sensors measure."""
    return SensedMotion(*_motion(truth))


class Noise(NamedTuple):
    """State of a compiled sensor between two ticks."""

    generators: tuple[Generator, ...]
    """Random streams, advanced in place."""
    values: Any
    """Named tuple of the numbers that change from tick to tick."""

    @property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of the random streams."""
        return tuple(map(address, self.generators))


class Sensor(Reporting):
    """Base class of all sensors: a kind overrides `init` and `measure`, and for the log `columns` and `report`."""

    def init(self, seed: int) -> Any:
        """Return the state before the first tick of a run with this `seed`."""
        raise NotImplementedError

    def measure(self, state: Any, truth: Truth, conditions: Conditions, dt: float) -> tuple[Any, Any]:
        """Return state and reading at the end of the tick of length `dt` [s] that ends at `truth.t`."""
        raise NotImplementedError


class CompiledSensor(Sensor):
    """Base class of sensors with a compiled law, which may be absent."""

    law: ClassVar[Callable[..., tuple[Any, Any]]]
    """Function of parameters, values, addresses of the random streams, and motion; returns values and reading."""
    absent: ClassVar[Any] = nan
    """Reading without the sensor."""

    enabled: bool = False
    """Whether the sensor is present."""

    def parameters(self, dt: float) -> Any:
        """Return the parameters of the law for ticks of length `dt` [s]."""
        raise NotImplementedError

    def measure(self, state: Noise, truth: Truth, conditions: Conditions, dt: float) -> tuple[Noise, Any]:
        """Return state and reading at the end of the tick of length `dt` [s] that ends at `truth.t`."""
        if not self.enabled:
            return state, self.absent
        law = type(self).law
        values, reading = law(self.parameters(dt), state.values, state.addresses, motion_of(truth))
        return state._replace(values=values), reading


class OptionalSensor(Sensor):
    """Base class of scalar sensors that the paper's tractor does not have."""

    column: ClassVar[Column]
    """Log column of the reading."""

    enabled: bool = False
    """Whether the sensor is present; otherwise the reading is NaN."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log column of the reading, if the sensor is present."""
        return (self.column,) if self.enabled else ()

    def report(self, reading: float) -> tuple[float, ...]:
        """Return the reading, if the sensor is present."""
        return (reading,) if self.enabled else ()
