"""Random roughness of an ISO 8608 class.

Profiles of the ground along straight lines have the one-sided power spectral density of displacement

    G_d(n) = G_d(n_0) (n / n_0)^-2,     n_0 = 0.1 cycle/m,

with the geometric mean G_d(n_0) of the class [ISO8608]. The surface is isotropic: it has a two-dimensional spectrum
S(k) of the wave number k [cycle/m] whose integral across a line is G_d / 2. The pure power law gives S = G_d(n_0)
n_0^2 / (4 k^3). G_d is rolled off below the Nyquist wave number of the grid, and the inverse Abel transform is

    S(k) = -1/pi int_k^inf G'(u) / sqrt(u^2 - k^2) du = -1/pi int_0^inf G'(k cosh v) dv,     G = G_d / 2.

The amplitudes are exact and the phases random, so that every realisation has the spectrum of its class. The field is
one period of the surface.

The spectrum along rows, columns and diagonals of nodes is within 10 % of the class up to min(2.83, 0.35 / node_m)
cycle/m. The range of ISO 8608 ends at 2.83; a contact patch averages over shorter waves. The lower limit is one cycle
over the field for complete rows; a window over a part of a row has spectral leakage below 5 cycles per window. Bilinear
interpolation smooths the heights between nodes: along any line the spectrum is within 10 % up to 0.07 / node_m.
"""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Array
from agrobot_mj.terrain.generated import Generated

REFERENCE_WAVE_NUMBER = 0.1  # Reference wave number n_0 [cycle/m] [ISO8608]
ROUGHNESS = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6}
"""Roughness G_d(n_0) of each class [m3]: geometric mean of the class [ISO8608]."""
HIGHEST_WAVE_NUMBER = 2.83  # Maximum wave number of ISO 8608 [cycle/m] [ISO8608]
ROLL_OFF = 0.7  # Wave number at which the roll-off starts, divided by the maximum of the spectrum [-]. Assumed value.


class Rough(Generated):
    """Terrain with random roughness of an ISO 8608 class."""

    VERTICAL: ClassVar[str] = "iso_class"

    kind: Literal["rough"] = "rough"
    iso_class: Literal["A", "B", "C", "D", "E"] = "C"
    """ISO 8608 class: A is a very good road, C a gravel road or farm track; D and E are fields and poor tracks."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of the random roughness, independent of the seed of the run."""

    def bare(self, x: Array, y: Array) -> Array:
        """Return the random heights [m] relative to the middle node of the height grid."""
        from scipy.fft import fftfreq, irfft2, rfft2, rfftfreq  # imported here: the import takes 0.05 s

        columns, rows = x.size - 1, y.size - 1
        east, north = float(x[-1] - x[0]), float(y[-1] - y[0])
        nyquist = columns / (2 * east)
        end = min(HIGHEST_WAVE_NUMBER / ROLL_OFF, nyquist)
        k = np.hypot(fftfreq(rows, north / rows)[:, None], rfftfreq(columns, east / columns)[None, :])
        # White noise gives the phases; its amplitudes are replaced. A cell of the discrete spectrum has the area
        # 1 / (east * north), and irfft2 divides by the number of nodes.
        noise = rfft2(stream(self.seed, "terrain.rough").normal(size=(rows, columns)))
        amplitude = np.sqrt(plane_spectrum(k, ROUGHNESS[self.iso_class], end)) / np.sqrt(east * north)
        tile = irfft2(noise / np.maximum(np.abs(noise), 1e-300) * amplitude * (rows * columns), s=(rows, columns))
        return np.pad(tile - tile[rows // 2, columns // 2], ((0, 1), (0, 1)), mode="wrap")


def plane_spectrum(k: Array, roughness: float, end: float) -> Array:
    """Return the two-dimensional spectrum S [m4] at the wave numbers `k` [cycle/m] for a `roughness` G_d(n_0) [m3].

    S is 0 at k = 0 and above the wave number `end` [cycle/m].
    """
    table = end * np.geomspace(1e-4, 1.0, 800)
    # The substitution u = k cosh(v) removes the singularity of the Abel transform at u = k.
    v = np.arccosh(end / table)[:, None] * np.linspace(0.0, 1.0, 400)
    s = np.trapezoid(-_line_slope(table[:, None] * np.cosh(v), roughness, end), v, axis=1) / np.pi
    # S k^3 is constant where the power law holds, so that its linear interpolation is almost exact.
    inside = (k > 0) & (k < end)
    safe = np.where(inside, k, end)
    return np.where(inside, np.interp(safe, table, s * table**3) / safe**3, 0.0)


def _line_slope(n: Array, roughness: float, end: float) -> Array:
    """Return the derivative of the two-sided profile spectrum [m4] at wave numbers `n` [cycle/m], 0 above `end`."""
    start = ROLL_OFF * end
    phase = np.pi * np.clip((n - start) / (end - start), 0.0, 1.0)
    whole, falling = (1 + np.cos(phase)) / 2, -np.sin(phase) * np.pi / (2 * (end - start))
    return roughness * REFERENCE_WAVE_NUMBER**2 / 2 * (falling / n**2 - 2 * whole / n**3)
