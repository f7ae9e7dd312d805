"""Contour lines: what makes a slope and its direction visible, from the side and from above.

They are those of the ground without its relief, so that furrows and bumps do not turn into lines of their own.
"""

from math import floor, log10

import numpy as np
import rerun as rr

from agrobot_mj.core.signals import Array

ENTITY = "world/contours"
COLOUR, WIDTH, LIFT_M = 0x20280FA0, rr.Radius.ui_points(0.6), 0.005
"""Lines lie below the reference path and the tracks, so that they hide neither."""
MOST_LINES = 24
"""Lines between the lowest and the highest place, at most."""
LEAST_RISE_M = 0.4
"""Height differences below this have no lines [m]."""


def interval(low: float, high: float) -> float | None:
    """Height between lines [m], a 1, 2 or 5 times a power of ten; None where the ground is level."""
    if high - low < LEAST_RISE_M:
        return None
    least = (high - low) / MOST_LINES
    decade = 10.0 ** floor(log10(least))
    return next(k * decade for k in (1, 2, 5, 10) if k * decade >= least * (1 - 1e-9))


def contours(corners: Array) -> Array:
    """Pieces of contour lines, (n, 2, 3) [m], of a surface through `corners` (rows, columns, 3)."""
    step = interval(float(corners[..., 2].min()), float(corners[..., 2].max()))
    if step is None:
        return np.empty((0, 2, 3))
    a, b, c, d = corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]
    triangles = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2).reshape(-1, 3, 3)
    levels = step * np.arange(np.ceil(corners[..., 2].min() / step), np.floor(corners[..., 2].max() / step) + 1)
    return np.concatenate([_crossing(triangles, level) for level in levels] or [np.empty((0, 2, 3))])


def _crossing(triangles: Array, level: float) -> Array:
    """Where `triangles` (m, 3, 3) are at the height `level`, (n, 2, 3)."""
    above = triangles[..., 2] > level
    count = above.sum(axis=1)
    crossed = (count == 1) | (count == 2)
    corners, above = triangles[crossed], above[crossed]
    # One corner is alone on its side of the level: the line crosses the two edges that meet there.
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
    at = np.arange(len(corners))
    start = corners[at, alone]
    ends = np.stack([corners[at, (alone + 1) % 3], corners[at, (alone + 2) % 3]], axis=1)
    share = (level - start[:, None, 2]) / (ends[..., 2] - start[:, None, 2])
    found: Array = start[:, None] + share[..., None] * (ends - start[:, None])
    return found


def contour_lines(corners: Array, lift: float = 0.0) -> rr.LineStrips3D | None:
    """The lines through `corners` (rows, columns, 3) as drawn, `lift` [m] higher; None where the ground is level."""
    pieces = contours(corners)
    if not len(pieces):
        return None
    lifted = pieces + np.array([0.0, 0.0, LIFT_M + lift])
    return rr.LineStrips3D(lifted.astype(np.float32), colors=COLOUR, radii=WIDTH)
