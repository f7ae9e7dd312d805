"""Tracks of the tractor: true position, estimated position, and GNSS fixes.

Tracks are sent in short segments, each with its end time. The layout shows all segments up to the current time.
"""

from typing import NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from rerun.components import LineStrip3DBatch

from agrobot_mj.core.palette import GREEN, ORANGE, VERMILION, rgba
from agrobot_mj.core.signals import Array
from agrobot_mj.recording.transport.timeline import Index, Times, send
from agrobot_mj.recording.world.ground import on_ground
from agrobot_mj.recording.world.names import ESTIMATED, TRUE
from agrobot_mj.simulation.log import Rows
from agrobot_mj.terrain import Ground

PIECE_TICKS = 5  # Number of ticks per segment of a track: 0.3 m at 1.2 m/s
FIX_COLOURS = np.array([rgba(VERMILION), rgba(ORANGE), rgba(GREEN), rgba(ORANGE)], dtype=np.uint32)
"""Colours of GNSS fixes of the qualities none, float, fix and DGPS."""
FIX_LIFT_M, FIX_RADIUS_M = 0.012, 0.02
"""Height of GNSS fixes above the ground, below the tracks [m], and radius of fixes [m], equal to the standard deviation
of the paper's receiver."""

STRIPS = LineStrip3DBatch([]).as_arrow_array().type


class DrawnTrack(NamedTuple):
    """Track that is extended during a run, with its log columns and line style."""

    name: str
    x: str  # Log column with the east coordinate
    y: str
    colour: int
    lift_m: float
    width: float  # Half width of the line on the screen [pixels]

    @property
    def entity(self) -> str:
        """Rerun entity path of the track."""
        return f"world/tracks/{self.name}"


TRACKS = (
    DrawnTrack("estimated", "x_hat", "y_hat", ESTIMATED, 0.015, 1.25),
    DrawnTrack("true", "x", "y", TRUE, 0.04, 1.5),
)
"""Tracks of the CG: the estimated track and, above it, the true track."""


class Tracks:
    """Recorder that sends the tracks of the tractor and the GNSS fixes to a recording."""

    def __init__(self, rows: Rows, ground: Ground) -> None:
        self.rows, self.ground = rows, ground

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Send the track segments and GNSS fixes of the log rows from `first`; `times` (n,) are the times of the
        rows."""
        ends = piece_ends(len(times))
        for track in TRACKS:
            pieces = rr.LineStrips3D.columns(strips=self._strips(track, first, ends))
            send(stream, track.entity, times[ends - 1], pieces)
            if first == 0:
                style = rr.LineStrips3D.from_fields(colors=track.colour, radii=rr.Radius.ui_points(track.width))
                stream.log(track.entity, style, static=True)
        self._send_fixes(stream, times[ends - 1], first, ends)

    def _strips(self, track: DrawnTrack, first: int, ends: Index) -> pa.Array:
        """Return consecutive segments of a track. Segment number k ends before the log row `first + ends[k]`."""
        before = min(first, 1)
        x, y = (self.rows.column(name, first - before)[: before + ends[-1]] for name in (track.x, track.y))
        points = on_ground(self.ground, np.column_stack([x, y]), track.lift_m)
        return strips(points, np.append(0, ends[:-1] + before - 1), ends + before)

    def _send_fixes(self, stream: rr.RecordingStream, times: Times, first: int, ends: Index) -> None:
        columns = ("gnss_x", "gnss_y", "gnss_quality")
        x, y, quality = (self.rows.column(name, first)[: ends[-1]] for name in columns)
        there = np.isfinite(x)
        points = on_ground(self.ground, np.column_stack([x, y])[there], FIX_LIFT_M)
        fixes = rr.Points3D.columns(positions=points, colors=FIX_COLOURS[quality[there].astype(int)])
        counts = np.diff(np.append(0, np.cumsum(there)[ends - 1]))
        send(stream, "world/tracks/gnss", times, fixes.partition(counts))
        if first == 0:
            stream.log("world/tracks/gnss", rr.Points3D.from_fields(radii=FIX_RADIUS_M), static=True)


def piece_ends(count: int) -> Index:
    """Return the exclusive end indices of track segments in `count` log rows: 5, 10, ..., `count`."""
    return np.append(np.arange(PIECE_TICKS, count, PIECE_TICKS), count)


def strips(points: Array, starts: Index, ends: Index) -> pa.Array:
    """Return the line strips `points[start:end]` as an Arrow array, which avoids Rerun's slow conversion."""
    rows = np.concatenate([np.arange(start, end) for start, end in zip(starts, ends, strict=True)])
    vectors = pa.FixedSizeListArray.from_arrays(points[rows].astype(np.float32).ravel(), type=STRIPS.value_type)
    return pa.ListArray.from_arrays(np.append(0, np.cumsum(ends - starts)).astype(np.int32), vectors, type=STRIPS)
