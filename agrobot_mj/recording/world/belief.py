"""What the estimator believes: the 3 sigma ellipse of its position of R, flat on the ground.

Drawn as a wire: the ellipse and its two axes.
"""

import numpy as np
import rerun as rr
from rerun.components import FillMode
from scipy.spatial.transform import Rotation

from agrobot_mj.core.signals import Array
from agrobot_mj.recording.transport.timeline import Times, send
from agrobot_mj.recording.world.ground import on_ground, slopes
from agrobot_mj.simulation.log import Rows
from agrobot_mj.terrain import Ground

ENTITY = "world/belief"
SIGMAS = 3.0
COLOUR, LIFT_M, WIDTH = 0xFFC857FF, 0.03, rr.Radius.ui_points(1.25)
THICKNESS_M, REACH_M = 1e-3, 0.2


class Belief:
    """Sends the ellipse of every tick."""

    def __init__(self, rows: Rows, ground: Ground) -> None:
        self.rows, self.ground = rows, ground

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Rows from `first` on, at `times` (n,)."""
        if first == 0:
            style = rr.Ellipsoids3D.from_fields(colors=COLOUR, line_radii=WIDTH, fill_mode=FillMode.MajorWireframe)
            stream.log(ENTITY, style, static=True)
        names = ("rear_x_hat", "rear_y_hat", "p_xx", "p_xy", "p_yy")
        x, y, *p = (self.rows.column(name, first)[: len(times)] for name in names)
        there = np.isfinite([x, y, *p]).all(axis=0)
        if not there.any():
            return
        centres = on_ground(self.ground, np.column_stack([x, y])[there], LIFT_M)
        axes, frames = ellipses(*(v[there] for v in p))
        tilted = _laid(frames, *slopes(self.ground, x[there], y[there], REACH_M))
        shapes = rr.Ellipsoids3D.columns(
            centers=centres.astype(np.float32),
            half_sizes=np.column_stack([SIGMAS * axes, np.full(len(axes), THICKNESS_M)]).astype(np.float32),
            quaternions=Rotation.from_matrix(tilted).as_quat().astype(np.float32),
        )
        send(stream, ENTITY, times[there], shapes)


def ellipses(p_xx: Array, p_xy: Array, p_yy: Array) -> tuple[Array, Array]:
    """Standard deviations along the axes of covariances, (n, 2) [m], and the first axis, (n, 2)."""
    p = np.stack([p_xx, p_xy, p_xy, p_yy], axis=-1).reshape(-1, 2, 2)
    variances, directions = np.linalg.eigh(p)
    return np.sqrt(np.maximum(variances, 0.0)), directions[:, :, 0]


def _laid(axis: Array, dx: Array, dy: Array) -> Array:
    """Frames (n, 3, 3) on ground of slopes `dx`, `dy` (n,), their first axis above `axis` (n, 2)."""
    first = np.column_stack([axis, axis[:, 0] * dx + axis[:, 1] * dy])
    normal = np.column_stack([-dx, -dy, np.ones(len(dx))])
    first, normal = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (first, normal))
    return np.stack([first, np.cross(normal, first), normal], axis=2)
