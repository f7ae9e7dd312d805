"""Colours of numeric values and of the ground."""

from collections.abc import Sequence

import numpy as np

from agrobot_mj.core.signals import Array

Colours = np.ndarray[tuple[int, ...], np.dtype[np.uint32]]
LEVEL = np.array([100.0, 116.0, 70.0])
LOW, HIGH = np.array([88.0, 82.0, 54.0]), np.array([150.0, 154.0, 100.0])
"""Colours (red, green, blue) of the lowest and highest ground. Medium heights have the colour `LEVEL`."""
FULL_COLOUR_M = 0.4  # Minimum height range over which the colours reach both ends of the ramp [m]
SOFT, FIRM, SOFT_PA, FIRM_PA = np.array([66.0, 44.0, 28.0]), np.array([158.0, 130.0, 92.0]), 2e5, 2e6
"""Colours (red, green, blue) of soft and firm soil, and cone indices of soft and firm soil [Pa]."""
WET, DRY = np.array([52.0, 92.0, 138.0]), np.array([186.0, 176.0, 130.0])
"""Colours (red, green, blue) of ground with reduced and with increased friction."""


def ramp(stops: Sequence[tuple[float, int]], values: Array) -> Colours:
    """Return the colours 0xRRGGBBAA of `values` (n,), interpolated between `stops`, which are pairs (value, colour)."""
    places = [place for place, _ in stops]
    found = np.zeros(values.shape, dtype=np.uint32)
    for shift in (24, 16, 8, 0):
        channel = np.interp(values, places, [colour >> shift & 0xFF for _, colour in stops])
        found |= np.rint(channel).astype(np.uint32) << np.uint32(shift)
    return found


def by_height(z: Array, low: float, high: float) -> Array:
    """Return colours (n, 3) of the heights `z` (n,) [m], from `LOW` at `low` through `LEVEL` to `HIGH` at `high`."""
    share = 2 * (z - (low + high) / 2) / max(high - low, FULL_COLOUR_M)
    up, down = np.clip(share, 0, 1)[:, None], np.clip(-share, 0, 1)[:, None]
    colours: Array = LEVEL + up * (HIGH - LEVEL) + down * (LOW - LEVEL)
    return colours


def by_soil(colours: Array, friction: Array, cone_index: Array) -> Array:
    """Return `colours` (n, 3) blended with soil colours, for friction scale (n,) [-] and cone index (n,) [Pa]."""
    firmness = np.clip((cone_index - SOFT_PA) / (FIRM_PA - SOFT_PA), 0, 1)[:, None]
    colours = _over(colours, SOFT + firmness * (FIRM - SOFT), np.where(cone_index > 0, 0.8, 0.0))
    colours = _over(colours, WET, np.clip(1.5 * (1 - friction), 0, 0.85))
    return _over(colours, DRY, np.clip(friction - 1, 0, 0.7))


def _over(below: Array, paint: Array, cover: Array) -> Array:
    mixed: Array = below + cover[:, None] * (paint - below)
    return mixed
