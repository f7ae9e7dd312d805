"""Name labels in the scene: for the reference, the true track and the estimated track, and for compared tractors."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from agrobot_mj.core.palette import ORANGE, SKY_BLUE, rgba
from agrobot_mj.core.signals import TICK_S, Array
from agrobot_mj.recording.transport.timeline import Times, send
from agrobot_mj.recording.world.ground import on_ground
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Rows
from agrobot_mj.terrain import Ground

ENTITY = "world/names"
REFERENCE, TRUE, ESTIMATED = 0xE8E8E8FF, rgba(SKY_BLUE), rgba(ORANGE)
AHEAD_M, BEHIND_M, LAST_M, ASIDE_M = 1.9, (1.4, 1.2), 2.2, 0.6
"""Distances of labels from the default tractor [m]: reference label ahead, labels of true and estimated track behind,
reference label behind at the end of the path, and labels of true and estimated track next to their track."""
IN_VIEW = 0.7
"""Scale of the labels divided by the distance between the first and the farthest body [1/m], for legible labels in a
view of all bodies."""
EVERY_TICKS = 2  # Number of ticks between recorded positions of a name


class TrackNames:
    """Recorder that sends the labels of the reference, the true track and the estimated track."""

    def __init__(self, rows: Rows, ground: Ground, scenario: Scenario, reference: Array) -> None:
        """Prepare the labels of the tracks. `reference` (n, 3) [m] is the drawn path, with points equally spaced in
        time."""
        self.rows, self.ground, self.reference = rows, ground, reference[:, :2]
        self.times = np.linspace(0.0, scenario.ticks * TICK_S, len(reference))
        self.size, self.speed = scenario.tractor.size, scenario.path.speed_m_s

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Send the label positions for every second log row from `first`. `times` (n,) are the times of the rows."""
        if first == 0:
            name_points(stream, ENTITY, ("reference", "true", "estimated"), (REFERENCE, TRUE, ESTIMATED))
        at = first + np.flatnonzero((first + np.arange(len(times))) % EVERY_TICKS == 0)
        columns = ("x", "y", "yaw"), ("x_hat", "y_hat", "yaw_hat")
        per_m = size_in_view(self.size, self.rows.poses[0, :, :2]) / self.speed
        t = self.rows.column("t")[at]
        ahead = t + AHEAD_M * per_m
        ahead[ahead > self.times[-1]] = t[ahead > self.times[-1]] - LAST_M * per_m
        tracks = [np.column_stack([np.interp(ahead, self.times, line) for line in self.reference.T])]
        left = ASIDE_M * per_m * self.speed
        for names, behind in zip(columns, BEHIND_M, strict=True):
            then = np.maximum(at - round(behind * per_m / TICK_S), 0)
            x, y, yaw = (self.rows.column(name)[then] for name in names)
            tracks.append(np.column_stack([x - left * np.sin(yaw), y + left * np.cos(yaw)]))
            left = -left  # both tracks nearly coincide, so their labels are on opposite sides
        places = on_ground(self.ground, np.stack(tracks, axis=1).reshape(-1, 2), 0.0)
        move_points(stream, ENTITY, times[at - first], places, len(tracks))


def size_in_view(size: float, places: Array) -> float:
    """Return the scale of camera and label distances, relative to the default tractor, for bodies at `places` (n, 2)
    [m].

    The first body is the tractor. The scale is the size of the tractor, or larger if other bodies are distant.
    """
    return max(size, IN_VIEW * float(np.hypot(*(places - places[0]).T).max()))


def name_points(stream: rr.RecordingStream, entity: str, labels: Sequence[str], colours: Sequence[int]) -> None:
    """Send the texts and colours of labels to `entity`. The function `move_points` sends the positions of the
    labels."""
    nothing = rr.Radius.ui_points(0.0)
    shown = np.array(colours, dtype=np.uint32)
    style = rr.Points3D.from_fields(labels=labels, colors=shown, radii=nothing, show_labels=True)
    stream.log(entity, style, static=True)


def move_points(stream: rr.RecordingStream, entity: str, times: Times, places: Array, names: int = 1) -> None:
    """Send the positions `places` (n * names, 3) [m] of `names` labels at the times `times` (n,)."""
    columns = rr.Points3D.columns(positions=places.astype(np.float32))
    send(stream, entity, times, columns.partition(np.full(len(times), names)))
