"""Base of all faults: a change of the tractor's `Conditions` in a window of time."""

from math import inf
from typing import Any, ClassVar

from numpy.random import Generator
from pydantic import model_validator

from agrobot_mj.core.signals import ROUNDING_S, Conditions
from agrobot_mj.core.spec import NonNegative, Positive, Spec


class Scripted(Spec):
    """A fault with its window; a kind overrides `apply`, and `init` if it remembers anything."""

    machine: ClassVar[bool] = False
    """Whether it acts on the tractor's body or tyres, which the bicycle does not have."""

    kind: str
    start_s: NonNegative = 0.0
    """Begin of the window [s]."""
    end_s: Positive | None = None
    """End of the window, that of the run when omitted [s]."""

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> "Scripted":
        if self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"end_s: must lie after start_s ({self.start_s:g}), got {self.end_s:g}")
        return self

    @property
    def subject(self) -> str:
        """Part that it acts on: two faults with the same subject must not overlap."""
        return self.kind

    @property
    def last_s(self) -> float:
        """End of the window, infinite where it is that of the run [s]."""
        return inf if self.end_s is None else self.end_s

    def active(self, t: float) -> bool:
        """Return whether `t` [s] lies in the window, its end omitted, give or take the rounding of a clock in ticks."""
        return self.start_s <= t + ROUNDING_S < self.last_s

    def grown(self, t: float, ramp_s: float) -> float:
        """Return the fraction of a fault that grows evenly over `ramp_s` [s] from the start of its window, 1 from then
        on [-]."""
        return min(max((t - self.start_s) / ramp_s, 0.0), 1.0) if ramp_s > 0.0 else 1.0

    def overlaps(self, other: "Scripted") -> bool:
        """Return whether both windows share any time."""
        return self.start_s < other.last_s and other.start_s < self.last_s

    def init(self, generator: Generator) -> Any:
        """Return the state before the first tick; all its randomness comes from `generator`."""
        return None

    def apply(self, state: Any, conditions: Conditions, t: float, dt: float) -> tuple[Any, Conditions]:
        """Return the changed conditions of the tick of length `dt` [s] that begins at `t` [s]; only asked while
        active."""
        raise NotImplementedError
