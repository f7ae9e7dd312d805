"""Quantities that were found, with their intervals of 95 %: as rows of tables and as numbers in JSON."""

from collections.abc import Iterator, Mapping
from math import floor, isfinite, log10
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from agrobot_mj.core.signals import Array
from agrobot_mj.metrics import unit_of

LEVEL = 0.95


class Quantity(NamedTuple):
    """Quantity with its interval, in the unit of its key; infinite without a bound."""

    value: float
    low: float
    high: float
    identified: bool
    """Whether the log identifies the quantity."""

    @property
    def half(self) -> float:
        """Half the interval."""
        return (self.high - self.low) / 2

    @property
    def rounded(self) -> float:
        """The value to the second digit of half its interval."""
        return rounded(self.value, self.half)

    @property
    def text(self) -> str:
        """The rounded value."""
        return f"{self.rounded:g}"

    @property
    def ends(self) -> tuple[str, str]:
        """Both ends of the interval, rounded as the value."""
        return f"{rounded(self.low, self.half):g}", f"{rounded(self.high, self.half):g}"

    def excludes(self, value: float) -> bool:
        """Return whether the interval does not hold a value."""
        return not self.low <= value <= self.high


Found = Mapping[str, Quantity]
"""Quantities by their keys."""
HEAD = ("quantity", "value", "from", "to", "unit", "identified")
"""Head of the table of quantities."""
UNITS = dict.fromkeys((f"{axle}_cornering_stiffness_n_rad" for axle in ("front", "rear")), "N/rad")
UNITS |= {"understeer_gradient_rad_s2_m": "rad s2/m", "backlash_deg": "deg", "steer.offset": "reading"}
"""Units of quantities that `unit_of` does not tell."""


def quantity_rows(found: Found, units: Mapping[str, str]) -> Iterator[tuple[str, ...]]:
    """Return the rows of the table of quantities; `units` are those not given in the keys."""
    for key, each in found.items():
        unit = units.get(key) or UNITS.get(key) or unit_of(key)
        yield key, each.text, *each.ends, unit, "yes" if each.identified else "no"


def quantity_numbers(found: Found) -> dict[str, dict[str, Any]]:
    """Return the quantities for JSON; null without a bound."""
    return {
        key: {name: value if isfinite(value) else None for name, value in each._asdict().items()}
        for key, each in found.items()
    }


def rounded(value: float, half: float) -> float:
    """Return a value rounded to the second digit of half its interval; six digits without an interval."""
    if not 0.0 < half < 1e300:
        return float(f"{value:.6g}")
    return round(value, 1 - floor(log10(half)))


def half_width(covariance: Array, gradient: Array, freedom: int) -> float:
    """Return half the interval of what changes by `gradient` (n,) with parameters of this covariance (Student's t)."""
    return float(stdtrit(max(freedom, 1), 0.5 + LEVEL / 2) * np.sqrt(gradient @ covariance @ gradient))
