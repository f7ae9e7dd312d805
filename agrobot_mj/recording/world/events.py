"""Event markers in the scene: start and end of faults, steering saturation, and outcome of the run.

A marker is a labelled point at the tractor position at the time of the event, and remains visible. The outcome of a run
that was not completed is marked above the tractor.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from agrobot_mj.faults import Scripted
from agrobot_mj.recording.plots.states import by_subject, under
from agrobot_mj.recording.transport.timeline import Times, nanoseconds, send
from agrobot_mj.recording.world.ground import on_ground
from agrobot_mj.simulation.log import Rows
from agrobot_mj.terrain import Ground

ENTITY = "world/events"
GOOD, DOUBTFUL, BAD = 0x6FE3B5FF, 0xFFC857FF, 0xFF9166FF
"""Colours of event markers: recovery, warning and failure."""
LIFT_M, ABOVE_M, RADIUS = 0.1, 2.4, rr.Radius.ui_points(5.0)
"""Height of markers above the ground [m], height of the outcome marker for the default tractor [m], and marker radius
on the screen [points]."""
MOST_EVENTS = 40  # Maximum number of markers, in addition to the outcome
QUIET_TICKS = 40  # Number of ticks without saturated steering after which the next saturation gets a marker


class Events:
    """Recorder that sends event markers to a recording."""

    def __init__(self, rows: Rows, ground: Ground, faults: Sequence[Scripted], size: float) -> None:
        self.rows, self.ground, self.faults, self.size = rows, ground, by_subject(faults), size
        self.count, self.limited = 0, -QUIET_TICKS - 1

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Send markers for the events in the log rows from `first`. `times` (n,) are the times of the rows."""
        found = self._faults(first, len(times)) + self._saturations(first, len(times))
        found = sorted(found)[: MOST_EVENTS - self.count]
        self.count += len(found)
        self._send(stream, found)

    def finish(self, stream: rr.RecordingStream, outcome: str, last: int) -> None:
        """Send a marker of the outcome at log row `last`, unless the run was completed."""
        if outcome != "completed":
            self._send(stream, [(last, outcome.replace("_", " "), BAD)], ABOVE_M * self.size)

    def _faults(self, first: int, count: int) -> list[tuple[int, str, int]]:
        found, before = [], min(first, 1)
        t = self.rows.column("t", first - before)[: before + count]
        for subject, faults in self.faults.items():
            active = np.append([False] * (1 - before), under(faults, t))
            for change in np.flatnonzero(np.diff(active.astype(int))):
                begins = bool(active[change + 1])
                label = f"{subject.replace('_', ' ').replace('gnss', 'GNSS')} {'begins' if begins else 'ends'}"
                found.append((first + int(change), label, BAD if begins else GOOD))
        return found

    def _saturations(self, first: int, count: int) -> list[tuple[int, str, int]]:
        found = []
        for row in first + np.flatnonzero(self.rows.column("steer_saturated", first)[:count] > 0):
            if row > self.limited + QUIET_TICKS:
                found.append((int(row), "steering at its limit", DOUBTFUL))
            self.limited = int(row)
        return found

    def _send(self, stream: rr.RecordingStream, found: list[tuple[int, str, int]], lift: float = LIFT_M) -> None:
        if not found:
            return
        rows = [row for row, _, _ in found]
        places = np.column_stack([self.rows.column(name)[rows] for name in ("x", "y")])
        columns = rr.Points3D.columns(
            positions=on_ground(self.ground, places, lift),
            labels=[label for _, label, _ in found],
            colors=np.array([colour for _, _, colour in found], dtype=np.uint32),
        )
        stream.log(ENTITY, rr.Points3D.from_fields(radii=RADIUS, show_labels=True), static=True)
        send(stream, ENTITY, nanoseconds(self.rows.column("t")[rows]), columns)
