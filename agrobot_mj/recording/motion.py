"""What moves: the pose of each body, and the tracks that grow behind the tractor.

Tracks are sent in short pieces, each at the time at which it ends; the layout shows all pieces up to the present.
"""

import numpy as np
import rerun as rr

from agrobot_mj.log import Rows
from agrobot_mj.plants.scene import Scene
from agrobot_mj.recording.scene import on_ground
from agrobot_mj.recording.timeline import TIMELINE, Times
from agrobot_mj.signals import Array
from agrobot_mj.terrain import Ground

PIECE_TICKS = 5
"""Ticks in a piece of track: 0.3 m at 1.2 m/s."""
TRACKS = {"true": (("x", "y"), 0x56B4E9FF), "estimated": (("x_hat", "y_hat"), 0xE69F00FF)}
"""Columns and colour of each track of the CG."""
TRACK_RADIUS_M = 0.04
GNSS_COLOURS = np.array([0xD55E00FF, 0xE69F00FF, 0x009E73FF], dtype=np.uint32)
"""By quality: none, float, fix."""
GNSS_RADIUS_M = 0.035


class Motion:
    """Sends poses and tracks."""

    def __init__(self, rows: Rows, scene: Scene, ground: Ground) -> None:
        self.rows, self.scene, self.ground = rows, scene, ground

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Rows `first` to `rows.filled` at `times` (n,)."""
        column = rr.TimeColumn(TIMELINE, duration=times)
        for i, body in enumerate(self.scene.bodies):
            pose = self.rows.poses[first : self.rows.filled, i]
            columns = rr.Transform3D.columns(translation=pose[:, :3], quaternion=pose[:, [4, 5, 6, 3]])
            stream.send_columns(f"world/bodies/{body}", [column], columns)
        ends = piece_ends(len(times))
        column = rr.TimeColumn(TIMELINE, duration=times[ends - 1])
        for name, (axes, colour) in TRACKS.items():
            strips = self._strips(axes, first, ends)
            stream.send_columns(f"world/tracks/{name}", [column], rr.LineStrips3D.columns(strips=strips))
            if first == 0:
                style = rr.LineStrips3D.from_fields(colors=colour, radii=TRACK_RADIUS_M)
                stream.log(f"world/tracks/{name}", style, static=True)
        self._send_fixes(stream, column, first, ends)

    def _strips(self, axes: tuple[str, str], first: int, ends: Array) -> list[Array]:
        """The pieces that end before the rows `first + ends`, each joined to the one before."""
        before = min(first, 1)
        x, y = (self.rows.column(name, first - before) for name in axes)
        points = on_ground(self.ground, np.column_stack([x, y]))
        starts = np.concatenate([[0], ends[:-1] + before - 1])
        return [points[start : end + before] for start, end in zip(starts, ends, strict=True)]

    def _send_fixes(self, stream: rr.RecordingStream, column: rr.TimeColumn, first: int, ends: Array) -> None:
        x, y, quality = (self.rows.column(name, first) for name in ("gnss_x", "gnss_y", "gnss_quality"))
        there = np.isfinite(x)
        points = on_ground(self.ground, np.column_stack([x, y])[there])
        counts = np.diff(np.concatenate([[0], np.cumsum(there)[ends - 1]]))
        columns = rr.Points3D.columns(positions=points, colors=GNSS_COLOURS[quality[there].astype(int)])
        stream.send_columns("world/tracks/gnss", [column], columns.partition(counts))
        if first == 0:
            stream.log("world/tracks/gnss", rr.Points3D.from_fields(radii=GNSS_RADIUS_M), static=True)


def piece_ends(count: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Where the pieces of `count` new rows end, as slices do: 5, 10, ... and the last."""
    return np.append(np.arange(PIECE_TICKS, count, PIECE_TICKS), count)
