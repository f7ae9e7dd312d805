"""Estimated quantities with 95 % intervals, for tables and JSON files."""

from collections.abc import Iterator, Mapping
from math import floor, isfinite, log10
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from agrobot_mj.core.signals import Array
from agrobot_mj.metrics import unit_of

LEVEL = 0.95


class Quantity(NamedTuple):
    """Estimated quantity with its 95 % interval, in the unit of its key. An unbounded interval has an infinite end."""

    value: float
    low: float
    high: float
    identified: bool  # Whether the log identifies the quantity

    @property
    def half(self) -> float:
        """Half width of the 95 % interval, in the unit given by the key."""
        return (self.high - self.low) / 2

    @property
    def rounded(self) -> float:
        """Value rounded to the second significant digit of the interval's half width."""
        return round_to_interval(self.value, self.half)

    @property
    def text(self) -> str:
        """Rounded value as text."""
        return f"{self.rounded:g}"

    @property
    def ends(self) -> tuple[str, str]:
        """Lower and upper end of the interval as strings, rounded to the last digit of the value."""
        return f"{round_to_interval(self.low, self.half):g}", f"{round_to_interval(self.high, self.half):g}"

    def excludes(self, value: float) -> bool:
        """Return whether the interval excludes a value."""
        return not self.low <= value <= self.high


Found = Mapping[str, Quantity]  # Identified quantities by key
HEAD = ("quantity", "value", "from", "to", "unit", "identified")  # Column heads of the table of quantities
UNITS = dict.fromkeys((f"{axle}_cornering_stiffness_n_rad" for axle in ("front", "rear")), "N/rad")
UNITS |= {"understeer_gradient_rad_s2_m": "rad s2/m", "backlash_deg": "deg", "steer.offset": "reading"}
"""Units of quantities whose keys do not contain the unit."""


def quantity_rows(found: Found, units: Mapping[str, str]) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a table of quantities. `units` contains the units of keys that do not contain a unit."""
    for key, each in found.items():
        unit = units.get(key) or UNITS.get(key) or unit_of(key)
        yield key, each.text, *each.ends, unit, "yes" if each.identified else "no"


def quantity_numbers(found: Found) -> dict[str, dict[str, Any]]:
    """Return the quantities as JSON values, with null for infinite numbers."""
    return {
        key: {name: value if isfinite(value) else None for name, value in each._asdict().items()}
        for key, each in found.items()
    }


def round_to_interval(value: float, half: float) -> float:
    """Return a value rounded to the second significant digit of a half width, or to six digits without an interval."""
    if not 0.0 < half < 1e300:
        return float(f"{value:.6g}")
    return round(value, 1 - floor(log10(half)))


def half_width(covariance: Array, gradient: Array, freedom: Array | float) -> float:
    """Return the half width of the 95 % Student t interval for a function of the fitted parameters.

    `gradient` (n,) contains the derivatives of the function. `freedom` is the number of degrees of freedom of the
    variances, equal for all or (n,). Its mean is weighted by the contributions of the variances.
    """
    parts = gradient**2 * np.diag(covariance)
    mean = float(np.sum(parts * freedom) / parts.sum()) if parts.any() else 1.0
    return float(stdtrit(max(mean, 1.0), 0.5 + LEVEL / 2) * np.sqrt(gradient @ covariance @ gradient))
