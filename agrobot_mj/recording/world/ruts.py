"""Ruts on the ground, in darker colours for deeper ruts.

Ruts are sent at the end of a run. A segment appears with its final depth when the first wheel reaches it.
"""

import numpy as np
import rerun as rr

from agrobot_mj.core.signals import Array
from agrobot_mj.recording.transport.timeline import TIMELINE, Index, nanoseconds
from agrobot_mj.recording.world.ground import on_ground
from agrobot_mj.terrain import Ground
from agrobot_mj.terrain.memory import RutMap

ENTITY = "world/ruts"
DRAWN_M, MOST_SQUARES = 0.1, 60_000
"""Side length of the drawn squares [m], which is doubled until the squares are few enough, and maximum number of
squares."""
LIFT_M = 0.003  # Height of the squares above the ground, below tyre marks and path [m]
PIECE_S = 5.0  # Driving time covered by one segment of the ruts [s]
PLACE_M = 0.5  # Size of the grid cells used to find the wheel that passes a point [m]
SHALLOW, DEEP, DEEP_M = np.array([120.0, 104.0, 70.0]), np.array([54.0, 36.0, 22.0]), 0.08
"""Colours (red, green, blue) of shallow and deep ruts, and depth from which ruts have the colour `DEEP` [m]."""


def send_ruts(stream: rr.RecordingStream, ruts: RutMap, ground: Ground, t: Array, wheels: Array) -> None:
    """Send the rut map `ruts` to a recording; `wheels` (n, 4, 2) [m] are the wheel positions at the times `t` (n,)
    [s]."""
    if not ruts.x.size:
        return
    squares, side = _squares(ruts)
    pieces = (_arrivals(squares[:, :2], t, wheels) // PIECE_S).astype(int)
    for piece in np.unique(pieces):
        stream.set_time(TIMELINE, duration=nanoseconds(np.array([piece * PIECE_S]))[0])
        stream.log(f"{ENTITY}/{piece}", _mesh(squares[pieces == piece], side, ground))
    stream.reset_time()


def _squares(ruts: RutMap) -> tuple[Array, float]:
    """Return the centres and mean depths of the drawn squares, shape (n, 3) [m], and the side length of a square
    [m]."""
    side = ruts.cell * max(1, round(DRAWN_M / ruts.cell))
    while True:
        keys = np.stack([np.floor(ruts.x / side), np.floor(ruts.y / side)], axis=1).astype(np.int64)
        found, where = np.unique(keys, axis=0, return_inverse=True)
        if len(found) <= MOST_SQUARES:
            break
        side *= 2
    deep = np.bincount(where.ravel(), ruts.depth) / np.bincount(where.ravel())
    return np.column_stack([(found + 0.5) * side, deep]), side


def _arrivals(points: Array, t: Array, wheels: Array) -> Array:
    """Return the time at which the first wheel reaches each of `points` (n, 2) [m], shape (n,) [s]."""
    places = np.floor(wheels.reshape(-1, 2) / PLACE_M).astype(np.int64)
    times = np.repeat(t, wheels.shape[1])
    known, first = np.unique(places, axis=0, return_index=True)
    by_place = dict(zip(map(tuple, known.tolist()), times[first].tolist(), strict=True))
    around = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    return np.array(
        [
            min(by_place.get((i + a, j + b), t[-1]) for a, b in around)
            for i, j in np.floor(points / PLACE_M).astype(np.int64).tolist()
        ]
    )


def _mesh(squares: Array, side: float, ground: Ground) -> rr.Mesh3D:
    corners = side / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    points = (squares[:, None, :2] + corners).reshape(-1, 2)
    share = np.clip(squares[:, 2] / DEEP_M, 0.0, 1.0)[:, None]
    starts: Index = 4 * np.arange(len(squares))
    return rr.Mesh3D(
        vertex_positions=on_ground(ground, points, LIFT_M).astype(np.float32),
        vertex_colors=np.repeat(SHALLOW + share * (DEEP - SHALLOW), 4, axis=0).astype(np.uint8),
        triangle_indices=(starts[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3).astype(np.uint32),
    )
