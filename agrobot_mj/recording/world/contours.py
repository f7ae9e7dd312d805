"""Contour lines: what makes a slope and its direction visible, from the side and from above.

They are those of the ground without its relief, so that furrows and bumps do not turn into lines of their own.
"""

from math import floor, log10
from typing import Any

import numpy as np
import rerun as rr
from contourpy import contour_generator

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


def contours(corners: Array) -> list[Array]:
    """Contour lines of a surface through `corners` (rows, columns, 3), each of shape (n, 3) [m]."""
    x, y, z = np.moveaxis(corners, -1, 0)
    step = interval(float(z.min()), float(z.max()))
    if step is None:
        return []
    levels = step * np.arange(np.ceil(z.min() / step), np.floor(z.max() / step) + 1)
    lines: list[Any] = contour_generator(x, y, z).multi_lines(levels)
    return [
        np.column_stack([line, np.full(len(line), level)])
        for level, found in zip(levels, lines, strict=True)
        for line in found
    ]


def contour_lines(corners: Array, lift: float = 0.0) -> rr.LineStrips3D | None:
    """The lines through `corners` (rows, columns, 3) as drawn, `lift` [m] higher; None where the ground is level."""
    lines = contours(corners)
    if not lines:
        return None
    above = np.array([0.0, 0.0, LIFT_M + lift])
    return rr.LineStrips3D([(line + above).astype(np.float32) for line in lines], colors=COLOUR, radii=WIDTH)
