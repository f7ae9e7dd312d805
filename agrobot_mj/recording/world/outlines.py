"""Outlines of areas on the ground, visible during the complete recording."""

from collections.abc import Sequence

import rerun as rr

from agrobot_mj.core.signals import Array
from agrobot_mj.recording.world.ground import on_ground
from agrobot_mj.terrain import Ground

LIFT_M = 0.02  # Height of outlines above the ground [m], above the reference path
WIDTH = rr.Radius.ui_points(1.0)  # Line width of outlines on the screen


def send_outlines(stream: rr.RecordingStream, ground: Ground, name: str, rings: Sequence[Array], colour: int) -> None:
    """Send closed lines `rings`, each with the shape (n, 2) [m], as entity `world/areas/<name>` in the colour
    0xRRGGBBAA."""
    lines = [on_ground(ground, ring, LIFT_M) for ring in rings]
    stream.log(f"world/areas/{name}", rr.LineStrips3D(lines, colors=colour, radii=WIDTH), static=True)
