"""Base classes of sensors, which compute a measurement from the true state once per tick.

A sensor is frozen data with keys under `[sensors.<name>]`. It has the methods `init(seed) -> state` and `measure(state,
truth, conditions, dt) -> (state, reading)`; the reading is a float or a NamedTuple in SI units and radians. Random
numbers come from `randomness.stream` under the name of the sensor. Each tick draws the same number of samples under all
conditions, so that no sensor changes the noise of another. `columns` and `report` log a reading.
"""

from typing import Any, ClassVar

from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Column, Conditions, Truth


class Sensor(Reporting):
    """Base class of all sensors: a kind overrides `init` and `measure`, and for the log `columns` and `report`."""

    def init(self, seed: int) -> Any:
        """Return the state before the first tick of a run with this `seed`."""
        raise NotImplementedError

    def measure(self, state: Any, truth: Truth, conditions: Conditions, dt: float) -> tuple[Any, Any]:
        """Return state and reading at the end of the tick of length `dt` [s] that ends at `truth.t`."""
        raise NotImplementedError


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
