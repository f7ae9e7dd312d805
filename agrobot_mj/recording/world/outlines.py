"""Outlines and images of areas on the ground, visible during the complete recording."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from agrobot_mj.core.signals import Array
from agrobot_mj.recording.world.ground import on_ground
from agrobot_mj.terrain import Ground

LIFT_M = 0.02  # Height of outlines above the ground [m], above the reference path
OPACITY = 0.5  # Opacity of images
WIDTH = rr.Radius.ui_points(1.0)  # Line width of outlines on the screen


def send_outlines(stream: rr.RecordingStream, ground: Ground, name: str, rings: Sequence[Array], colour: int) -> None:
    """Send closed lines `rings`, each with the shape (n, 2) [m], as entity `world/areas/<name>` in the colour
    0xRRGGBBAA."""
    lines = [on_ground(ground, ring, LIFT_M) for ring in rings]
    stream.log(f"world/areas/{name}", rr.LineStrips3D(lines, colors=colour, radii=WIDTH), static=True)


def send_grid(
    stream: rr.RecordingStream,
    name: str,
    colours: "np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]",
    corner: tuple[float, float, float],
    cell: float,
) -> None:
    """Send a horizontal image (rows, columns, 3) of RGB cells, row 0 in the north, as entity `world/areas/<name>`.

    `corner` is the position of the south-west corner [m], and `cell` the side length of a cell [m].
    """
    height, width, _ = colours.shape
    form = rr.components.ImageFormat(width, height, color_model="RGB", channel_datatype="U8")
    grid = rr.GridMap(data=colours.tobytes(), format=form, cell_size=cell, translation=corner, opacity=OPACITY)
    stream.log(f"world/areas/{name}", grid, static=True)
