"""States over time as coloured lanes: GNSS solution, steering limit, supervisor, link, faults and run outcome.

A lane in `LANES` is recorded if the log contains its column. Only changes of a state are sent.
"""

from collections.abc import Sequence
from typing import NamedTuple, get_args

import numpy as np
import rerun as rr

from agrobot_mj.control.supervisor import Mode
from agrobot_mj.core.palette import GREEN, ORANGE, VERMILION, rgba
from agrobot_mj.core.signals import Array, Outcome
from agrobot_mj.faults import Scripted
from agrobot_mj.recording.transport.timeline import Times, nanoseconds, send
from agrobot_mj.simulation.log import Rows

GOOD, DOUBTFUL, BAD, PLAIN = rgba(GREEN), rgba(ORANGE), rgba(VERMILION), 0x56708AFF


class Lane(NamedTuple):
    """Lane of a state over time. A state is an index, counted from 0, into `labels` and `colours`."""

    path: str
    labels: tuple[str, ...]
    colours: tuple[int, ...]
    column: str = ""
    faults: tuple[Scripted, ...] = ()
    """Faults of a fault lane, which has no log column. The state is 1 while at least one of the faults is active."""

    @property
    def entity(self) -> str:
        """Rerun entity path of the lane."""
        return f"states/{self.path}"

    def values(self, rows: Rows, first: int) -> Array:
        """Return the state in each log row from `first`, shape (n,)."""
        if self.faults:
            return under(self.faults, rows.column("t", first)).astype(float)
        return rows.column(self.column, first)

    def label(self, value: int) -> str:
        """Return the label of the state `value`, or `unknown` for a missing or undefined state."""
        return self.labels[value] if 0 <= value < len(self.labels) else UNKNOWN


UNKNOWN = "unknown"  # Label of a missing or undefined state
LANES = (
    Lane("gnss", ("none", "float", "fix", "DGPS"), (BAD, DOUBTFUL, GOOD, DOUBTFUL), "gnss_quality"),
    Lane("steering", ("free", "at its limit"), (GOOD, BAD), "steer_saturated"),
    Lane(
        "supervisor",
        tuple(mode.name.lower() for mode in Mode),
        (PLAIN, DOUBTFUL, GOOD, DOUBTFUL, BAD),
        "supervisor_state",
    ),
    Lane("fix_gate", ("accepted", "rejected"), (GOOD, BAD), "fix_rejected"),
    Lane("estimator", ("consistent", "inconsistent"), (GOOD, BAD), "estimator_inconsistent"),
    Lane("link", ("not engaged", "engaged"), (PLAIN, GOOD), "link_engaged"),
)
RUNNING = "running"
ENDS = dict.fromkeys(get_args(Outcome), BAD) | {"completed": GOOD, "aborted": DOUBTFUL}
RUN = Lane("run", (RUNNING, *ENDS), (PLAIN, *ENDS.values()))
"""Lane of the run state: `running`, then the outcome."""


def by_subject(faults: Sequence[Scripted]) -> dict[str, tuple[Scripted, ...]]:
    """Return the faults grouped by the component that they affect (subject); each group has one lane."""
    subjects = dict.fromkeys(fault.subject for fault in faults)
    return {subject: tuple(fault for fault in faults if fault.subject == subject) for subject in subjects}


def under(faults: Sequence[Scripted], t: Array) -> "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]":
    """Return whether at least one of `faults` is active at each time `t` (n,) [s]."""
    return np.array([any(fault.active(at) for fault in faults) for at in t.tolist()], dtype=bool)


class States:
    """Recorder that sends each change of a state to the lane of the state."""

    def __init__(self, rows: Rows, faults: Sequence[Scripted]) -> None:
        scripted = [
            Lane(f"fault/{subject}", ("off", "active"), (PLAIN, BAD), faults=same)
            for subject, same in by_subject(faults).items()
        ]
        self.rows = rows
        self.lanes = [*(lane for lane in LANES if lane.column in rows.columns), *scripted]

    @property
    def count(self) -> int:
        """Number of lanes, including the run lane."""
        return len(self.lanes) + 1

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Send the state changes in the log rows from `first` to `rows.filled`; `times` (n,) are the times of the
        rows."""
        if first == 0:
            stream.log(RUN.entity, _style(RUN), static=True)
            _send(stream, RUN, times[:1], [RUNNING])
        for lane in self.lanes:
            found = lane.values(self.rows, max(first - 1, 0))
            values = np.where((found >= 0) & (found < len(lane.labels)), found, -1.0).astype(int)
            changed = np.flatnonzero(np.diff(values))
            if first == 0:
                changed = np.append(0, changed + 1)
                stream.log(lane.entity, _style(lane), static=True)
            if changed.size:
                _send(stream, lane, times[changed], [lane.label(v) for v in values[changed + min(first, 1)].tolist()])

    def finish(self, stream: rr.RecordingStream, outcome: str) -> None:
        """Send the outcome of the run as the last state of the run lane."""
        if self.rows.filled:
            _send(stream, RUN, nanoseconds(self.rows.column("t")[-1:]), [outcome])


def _send(stream: rr.RecordingStream, lane: Lane, times: Times, states: list[str]) -> None:
    send(stream, lane.entity, times, rr.StateChange.columns(state=states))


def _style(lane: Lane) -> rr.StateConfiguration:
    return rr.StateConfiguration(values=lane.labels, colors=np.array(lane.colours, dtype=np.uint32))
