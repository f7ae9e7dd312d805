"""Colours that stand for a number."""

from collections.abc import Sequence

import numpy as np

from agrobot_mj.signals import Array

Colours = np.ndarray[tuple[int, ...], np.dtype[np.uint32]]


def ramp(stops: Sequence[tuple[float, int]], values: Array) -> Colours:
    """Colours 0xRRGGBBAA (n,) of `values` (n,), between the values and colours of `stops`, which ascend."""
    places = [place for place, _ in stops]
    found = np.zeros(values.shape, dtype=np.uint32)
    for shift in (24, 16, 8, 0):
        channel = np.interp(values, places, [colour >> shift & 0xFF for _, colour in stops])
        found |= np.rint(channel).astype(np.uint32) << np.uint32(shift)
    return found
