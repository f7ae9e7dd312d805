"""Base of sensors: true state in, measurement out, once per tick.

A sensor is frozen data with keys under `[sensors.<name>]`. `init(seed) -> state` and `measure(state, truth, conditions,
dt) -> (state, reading)`; the measurement is a float or a NamedTuple, in SI units and radians. Random numbers come from
`randomness.stream` under a name of the sensor, and each tick draws the same number of samples for all conditions, so
that no sensor changes the noise of another. `columns` and `report` log a measurement.
"""

from typing import Any, ClassVar

from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Column, Conditions, Truth


class Sensor(Reporting):
    """Base of all sensors: `init` and `measure`, and to be logged `columns` and `report` of a reading."""

    def init(self, seed: int) -> Any:
        """Return the state before the first tick of the run with this `seed`."""
        raise NotImplementedError

    def measure(self, state: Any, truth: Truth, conditions: Conditions, dt: float) -> tuple[Any, Any]:
        """Return the state and reading at the end of the tick of length `dt` [s] that ends at `truth.t`."""
        raise NotImplementedError


class OptionalSensor(Sensor):
    """Base of a sensor of one number that the paper's tractor does not have."""

    column: ClassVar[Column]
    """Column of its reading."""

    enabled: bool = False
    """Whether the sensor is present; otherwise the measurement is NaN."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Column of the measurement, if the sensor is present."""
        return (self.column,) if self.enabled else ()

    def report(self, reading: float) -> tuple[float, ...]:
        """Return the measurement, if the sensor is present."""
        return (reading,) if self.enabled else ()
