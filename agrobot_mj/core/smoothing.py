"""Centred moving average, used only in figures and recordings."""

import numpy as np

from agrobot_mj.core.signals import Array


def moving_mean(values: Array, count: int) -> Array:
    """Return the mean of the finite `values` (n,) in `count` rows centred at each row; NaN where no value is finite."""
    finite, window = np.isfinite(values), np.ones(max(1, min(len(values), count)))
    total = np.convolve(np.where(finite, values, 0.0), window, "same")
    counted = np.convolve(finite, window, "same")
    mean: Array = np.divide(total, counted, out=np.full(len(values), np.nan), where=counted > 0.5)
    return mean
