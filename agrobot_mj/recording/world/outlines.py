"""Outlines and images of areas on the ground, visible during the complete recording."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from agrobot_mj.core.signals import Array
from agrobot_mj.recording.world.ground import grid_triangles, on_ground
from agrobot_mj.terrain import Ground

LIFT_M = 0.02  # Height of outlines above the ground [m], above the reference path
OPACITY = 0.5  # Opacity of images
LEVEL_M = 0.05  # Maximum height difference of ground on which an image is horizontal [m]
MESH_M, MOST_VERTICES = 1.0, 40_000  # Minimum point distance [m] and maximum number of points of the mesh of an image
WIDTH = rr.Radius.ui_points(1.0)  # Line width of outlines on the screen


def send_outlines(stream: rr.RecordingStream, ground: Ground, name: str, rings: Sequence[Array], colour: int) -> None:
    """Send closed lines `rings`, each with the shape (n, 2) [m], as entity `world/areas/<name>` in the colour
    0xRRGGBBAA."""
    lines = [on_ground(ground, ring, LIFT_M) for ring in rings]
    stream.log(f"world/areas/{name}", rr.LineStrips3D(lines, colors=colour, radii=WIDTH), static=True)


def send_image(
    stream: rr.RecordingStream,
    ground: Ground,
    name: str,
    colours: "np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]",
    corner: tuple[float, float],
    cell: float,
) -> None:
    """Send an image (rows, columns, 3) of RGB cells that covers the ground, row 0 in the north, as entity
    `world/areas/<name>`.

    `corner` is the position of the south-west corner [m], and `cell` the side length of a cell [m]. On level ground the
    image is a grid map, otherwise the texture of a mesh.
    """
    height, width, _ = colours.shape
    form = rr.components.ImageFormat(width, height, color_model="RGB", channel_datatype="U8")
    if np.ptp(ground.heights) <= LEVEL_M:
        place = (*corner, float(ground.heights.max()) + LIFT_M / 2)
        shape = rr.GridMap(data=colours.tobytes(), format=form, cell_size=cell, translation=place, opacity=OPACITY)
        stream.log(f"world/areas/{name}", shape, static=True)
        return
    size = np.array([width, height]) * cell
    step = max(MESH_M, float(np.sqrt(size.prod() / MOST_VERTICES)))
    columns, rows = np.ceil(size / step).astype(int)
    u, v = np.meshgrid(np.arange(columns + 1) / columns, np.arange(rows + 1) / rows)
    mesh = rr.Mesh3D(
        vertex_positions=on_ground(ground, corner + np.column_stack([u.ravel(), v.ravel()]) * size, LIFT_M / 2),
        vertex_texcoords=np.column_stack([u.ravel(), 1 - v.ravel()]),
        triangle_indices=grid_triangles(rows, columns).reshape(-1, 3),
        albedo_texture=colours,
        albedo_factor=[255, 255, 255, round(255 * OPACITY)],
    )
    stream.log(f"world/areas/{name}", mesh, static=True)
