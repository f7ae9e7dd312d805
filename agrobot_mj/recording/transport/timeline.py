"""Shared definitions of recordings: application name, timeline `sim_time` (simulated time), and data columns."""

from collections.abc import Iterable

import numpy as np
import rerun as rr

from agrobot_mj.core.signals import Array

APPLICATION = "agrobot_mj"
TIMELINE = "sim_time"
Index = np.ndarray[tuple[int, ...], np.dtype[np.int64]]  # Array of integer indices, such as row numbers of the log
Times = np.ndarray[tuple[int, ...], np.dtype[np.timedelta64]]


def nanoseconds(t: Array) -> Times:
    """Return times (n,) [s] as integer nanoseconds, so that equal times compare equal."""
    return np.rint(t * 1e9).astype("timedelta64[ns]")


def send(stream: rr.RecordingStream, entity: str, times: Times, columns: Iterable[rr.ComponentColumn]) -> None:
    """Send data columns to the entity `entity` of a recording, with values at the times `times` (n,)."""
    stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=times)], columns)


def data_column(descriptor: rr.ComponentDescriptor, batch: rr.ComponentBatchLike, size: int = 1) -> rr.ComponentColumn:
    """Return a data column with `size` values of a Rerun component at each time.

    The method `columns` of a Rerun archetype returns the same column, but takes four times as long.
    """
    offsets = np.arange(0, len(batch.as_arrow_array()) + 1, size, dtype=np.int32)
    return rr.ComponentColumn(descriptor, batch, offsets=offsets)
