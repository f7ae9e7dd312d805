"""Base class of all faults. A fault changes the `Conditions` of the ticks within a time window."""

from math import inf
from typing import Any, ClassVar

from numpy.random import Generator
from pydantic import model_validator

from agrobot_mj.core.signals import ROUNDING_S, Conditions
from agrobot_mj.core.spec import NonNegative, Positive, Spec


class Scripted(Spec):
    """Base class of faults with a time window. Subclasses override `apply`, and `init` if the fault has a state."""

    machine: ClassVar[bool] = False
    """Whether the fault acts on the body or the tyres of the tractor, which the bicycle plant does not model."""

    kind: str
    start_s: NonNegative = 0.0
    """Time at which the fault starts [s]."""
    end_s: Positive | None = None
    """Time at which the fault ends [s]. Default: the end of the run."""

    @model_validator(mode="after")
    def _check_times(self) -> "Scripted":
        if self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"end_s: must be above start_s ({self.start_s:g}), got {self.end_s:g}")
        return self

    @property
    def subject(self) -> str:
        """Component affected by the fault. Time windows of faults with the same subject must not overlap."""
        return self.kind

    @property
    def last_s(self) -> float:
        """End of the time window [s], or infinity for a fault without `end_s`."""
        return inf if self.end_s is None else self.end_s

    def active(self, t: float) -> bool:
        """Return whether the fault is active at time `t` [s], with a tolerance for rounding errors at start and end."""
        return self.start_s <= t + ROUNDING_S < self.last_s

    def strength_at(self, t: float, ramp_s: float) -> float:
        """Return the strength of the fault [-] at time `t` [s], which grows linearly from 0 to 1 within `ramp_s`
        [s]."""
        return min(max((t - self.start_s) / ramp_s, 0.0), 1.0) if ramp_s > 0.0 else 1.0

    def overlaps(self, other: "Scripted") -> bool:
        """Return whether the time windows of this fault and of `other` overlap."""
        return self.start_s < other.last_s and other.start_s < self.last_s

    def init(self, generator: Generator) -> Any:
        """Return the state of the fault before the first tick; the fault draws random numbers from `generator`."""
        return None

    def apply(self, state: Any, conditions: Conditions, t: float, dt: float) -> tuple[Any, Conditions]:
        """Return the new fault state and the changed conditions, for a tick of `dt` [s] that starts at `t` [s]."""
        raise NotImplementedError
