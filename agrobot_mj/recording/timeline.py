"""What all recordings share: the application's name, and the one timeline `sim_time`, since the start of the run."""

import numpy as np

from agrobot_mj.signals import Array

APPLICATION = "agrobot_mj"
TIMELINE = "sim_time"
Index = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
"""Rows of the log, or tiles."""
Times = np.ndarray[tuple[int, ...], np.dtype[np.timedelta64]]


def nanoseconds(t: Array) -> Times:
    """Seconds (n,) as whole nanoseconds, so that equal times are equal."""
    return np.rint(t * 1e9).astype("timedelta64[ns]")
