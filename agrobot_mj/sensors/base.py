"""What every sensor fills: truth in, reading out, once per tick.

A sensor is frozen data with its keys under `[sensors.<name>]`. `init(seed) -> state` and `measure(state, truth,
conditions, dt) -> (state, reading)`; the reading is a float or a NamedTuple, in SI units and radians. Randomness comes
from `randomness.stream` under a name of the sensor's own, and each tick draws the same number of variates whatever
the conditions, so that no sensor ever shifts another's noise. `columns` and `report` log a reading.
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
    """Whether there is one; the reading is NaN without."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The reading, where there is a sensor."""
        return (self.column,) if self.enabled else ()

    def report(self, reading: float) -> tuple[float, ...]:
        """Return the reading, where there is a sensor."""
        return (reading,) if self.enabled else ()
