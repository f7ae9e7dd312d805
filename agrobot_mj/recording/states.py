"""What is going on, as lanes: the GNSS solution and the steering limit. Only changes are sent."""

from typing import NamedTuple

import numpy as np
import rerun as rr

from agrobot_mj.log import Rows
from agrobot_mj.recording.timeline import TIMELINE, Times

GOOD, DOUBTFUL, BAD = 0x009E73FF, 0xE69F00FF, 0xD55E00FF


class Lane(NamedTuple):
    """One entity `states/<path>`; a state is the value of a column, counted from 0."""

    path: str
    column: str
    labels: tuple[str, ...]
    colours: tuple[int, ...]

    @property
    def entity(self) -> str:
        """Where the lane is in the recording."""
        return f"states/{self.path}"


LANES = (
    Lane("gnss", "gnss_quality", ("none", "float", "fix"), (BAD, DOUBTFUL, GOOD)),
    Lane("steering", "steer_saturated", ("free", "at its limit"), (GOOD, BAD)),
)


class States:
    """Sends each lane's state when it changes."""

    def __init__(self, rows: Rows) -> None:
        self.rows = rows

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """The changes in rows `first` to `rows.filled` at `times` (n,)."""
        for lane in LANES:
            values = self.rows.column(lane.column, max(first - 1, 0))
            changed = np.flatnonzero(np.diff(values))
            if first == 0:
                changed = np.append(0, changed + 1)
                stream.log(lane.entity, _style(lane), static=True)
            if changed.size:
                states = [lane.labels[int(value)] for value in self.rows.column(lane.column, first)[changed]]
                column = rr.TimeColumn(TIMELINE, duration=times[changed])
                stream.send_columns(lane.entity, [column], rr.StateChange.columns(state=states))


def _style(lane: Lane) -> rr.StateConfiguration:
    return rr.StateConfiguration(values=lane.labels, colors=np.array(lane.colours, dtype=np.uint32))
