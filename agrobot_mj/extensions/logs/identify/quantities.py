"""Quantities that were found, with their intervals of 95 %."""

from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.logs.annotated import rounded

LEVEL = 0.95


class FoundQuantity(NamedTuple):
    """A quantity with its interval, in the unit of its key; None where there is none."""

    value: float | None
    low: float | None
    high: float | None
    identified: bool


class Interval(NamedTuple):
    """A quantity with its interval, in the unit of its key."""

    value: float
    low: float
    high: float
    identified: bool
    """Whether the log tells it."""

    @property
    def rounded(self) -> float:
        """The value to the second digit of half its interval."""
        return rounded(self.value, (self.high - self.low) / 2)

    @property
    def text(self) -> str:
        """The rounded value."""
        return f"{self.rounded:g}"

    @property
    def ends(self) -> tuple[str, str]:
        """Both ends of the interval, rounded as the value."""
        half = (self.high - self.low) / 2
        return f"{rounded(self.low, half):g}", f"{rounded(self.high, half):g}"

    def excludes(self, value: float) -> bool:
        """Whether the interval does not hold a value."""
        return not self.low <= value <= self.high


def half_width(covariance: Array, gradient: Array, freedom: int) -> float:
    """Half the interval of what changes by `gradient` (n,) with parameters of this covariance, by Student's t."""
    return float(stdtrit(max(freedom, 1), 0.5 + LEVEL / 2) * np.sqrt(gradient @ covariance @ gradient))
