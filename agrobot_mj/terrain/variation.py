"""Random variation of soil strength, friction and moisture over a field, and named surfaces.

Each quantity is a stationary Gaussian process with the autocorrelation exp(-distance / correlation length), generated
on a grid by circulant embedding, which reproduces variance and correlation of the process exactly. Strength and
friction are log-normal with the requested mean and coefficient of variation; moisture is normal and affects both.
"""

from math import ceil, log1p, sqrt
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import FIRMEST_KPA, SOFTEST_KPA, ConeIndex, Fraction, Spec

SurfaceName = Literal["concrete", "stubble", "tilled", "sand"]


class SurfaceProperties(NamedTuple):
    """Properties of a named surface."""

    cone_index_kpa: float  # Cone index [kPa]
    rolling_resistance: float  # Rolling resistance divided by the load [-], for tyres on firm ground
    friction: float  # Factor on the tyre friction [-]


NAMED: dict[str, SurfaceProperties] = {
    "concrete": SurfaceProperties(5000.0, 0.020, 1.1),
    "stubble": SurfaceProperties(1200.0, 0.058, 1.0),
    "tilled": SurfaceProperties(900.0, 0.065, 0.9),
    "sand": SurfaceProperties(450.0, 0.090, 0.7),
}
"""Properties of the named surfaces.

Cone index and rolling resistance 1 / B_n + 0.04 of firm soil (stubble), tilled soil and sand are from [ASAE2003],
quoted from memory, with the mobility numbers B_n = 55, 40 and 20. Assumed values: concrete (resistance 0.015-0.025, the
maximum accepted cone index), and all frictions (concrete 1-1.2, tilled 0.8-1, sand 0.5-0.8).
"""

LEAST_FRICTION, MOST_FRICTION = 0.05, 3.0  # Minimum and maximum of the random friction factor [-]. Assumed values.
CELLS_PER_LENGTH = 4  # Default number of cells per correlation length [-]
EDGE_LENGTHS = 6
"""Margin of the embedding grid divided by the correlation length [-], over which the correlation falls to 0.25 %."""


class Variation(Spec):
    """Random variation of ground properties (`[terrain.variation]`) outside the patches."""

    cone_index_kpa: ConeIndex | None = None
    """Mean cone index [kPa]. Default: cone index of `terrain.surface`."""
    cone_index_spread: Annotated[float, Field(ge=0, le=2)] = 0.0
    """Standard deviation of the cone index divided by its mean [-]. Assumed value (range 0.2-0.5 within a field)."""
    friction_spread: Annotated[float, Field(ge=0, le=2)] = 0.0
    """Standard deviation of the friction divided by its mean [-]. Assumed value (range 0-0.2)."""
    moisture_sd_percent: Annotated[float, Field(ge=0, le=20)] = 0.0
    """Standard deviation of the soil moisture, in percent of the dry mass [%]. Assumed value (range 1-4 within a
    field)."""
    cone_index_per_percent: Fraction = 0.08
    """Relative decrease of the cone index per percentage point of moisture [-]. Assumed value (range 0.05-0.15)."""
    friction_per_percent: Fraction = 0.02
    """Relative decrease of the friction per percentage point of moisture [-]. Assumed value (range 0-0.05)."""
    correlation_m: Annotated[float, Field(ge=0.1, le=1000)] = 5.0
    """Correlation length: distance at which the correlation is 37 % [m]. Assumed value (range 2-30)."""
    cell_m: Annotated[float, Field(ge=0.05, le=100)] | None = None
    """Side length of the grid cells [m]. Default: a quarter of the correlation length."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of the random variation, independent of the seed of the run."""

    @property
    def active(self) -> bool:
        """Whether at least one ground property varies randomly."""
        return max(self.cone_index_spread, self.friction_spread, self.moisture_sd_percent) > 0.0

    @property
    def cell(self) -> float:
        """Side length of the grid cells [m]: `cell_m` if given, otherwise a quarter of the correlation length."""
        return self.correlation_m / CELLS_PER_LENGTH if self.cell_m is None else self.cell_m

    def properties(self, shape: tuple[int, int], cell: float, mean_kpa: float | None) -> tuple[Array, Array]:
        """Return the friction factor [-] and cone index [Pa] in a grid of square cells with the side length `cell` [m].

        The cone index is 0 without a mean. Raises a ValueError that names the key of a missing mean.
        """
        mean = mean_kpa if self.cone_index_kpa is None else self.cone_index_kpa
        if mean is None and self.cone_index_spread > 0.0:
            raise ValueError("cone_index_kpa: the mean value is missing; set this key, or terrain.surface")
        wet = self._gaussian("moisture", shape, cell, self.moisture_sd_percent)
        friction = self._log_normal("friction", shape, cell, self.friction_spread)
        friction = np.clip(friction * np.exp(-self.friction_per_percent * wet), LEAST_FRICTION, MOST_FRICTION)
        if mean is None:
            return friction, np.zeros(shape)
        strength = mean * self._log_normal("cone_index", shape, cell, self.cone_index_spread)
        strength = np.clip(strength * np.exp(-self.cone_index_per_percent * wet), SOFTEST_KPA, FIRMEST_KPA)
        return friction, 1e3 * strength

    def _log_normal(self, name: str, shape: tuple[int, int], cell: float, spread: float) -> Array:
        variance = log1p(spread * spread)
        return np.exp(self._gaussian(name, shape, cell, sqrt(variance)) - variance / 2)

    def _gaussian(self, name: str, shape: tuple[int, int], cell: float, sd: float) -> Array:
        if sd <= 0.0:
            return np.zeros(shape)
        noise = stream(self.seed, f"terrain.variation.{name}")
        return sd * gaussian_field(noise, shape, cell / self.correlation_m)


def gaussian_field(noise: np.random.Generator, shape: tuple[int, int], cell: float) -> Array:
    """Return a random Gaussian field of unit variance with the autocorrelation exp(-distance).

    Distances and the cell size `cell` are divided by the correlation length [-].
    """
    from scipy.fft import irfft2, next_fast_len, rfft2  # imported here, because the import takes 0.05 s

    rows, columns = (next_fast_len(n + ceil(EDGE_LENGTHS / cell), real=True) for n in shape)
    away = [cell * np.minimum(np.arange(n), n - np.arange(n)) for n in (rows, columns)]
    spectrum = rfft2(np.exp(-np.hypot(away[0][:, None], away[1][None, :]))).real
    white = rfft2(noise.standard_normal((rows, columns)))
    field: Array = irfft2(white * np.sqrt(np.maximum(spectrum, 0.0)), s=(rows, columns))
    return np.ascontiguousarray(field[: shape[0], : shape[1]])


def named_surface(surface: SurfaceName | None) -> tuple[float, float, float]:
    """Return friction factor [-], cone index [Pa] and rolling resistance [-] of a named surface; (1, 0, 0) for None."""
    if surface is None:
        return 1.0, 0.0, 0.0
    found = NAMED[surface]
    return found.friction, 1e3 * found.cone_index_kpa, found.rolling_resistance
