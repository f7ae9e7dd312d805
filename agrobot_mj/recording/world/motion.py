"""Moving content of the scene: body poses, tracks, tyre marks, forces, uncertainty ellipse and markers.

The uncertainty ellipse is a line on the ground at 3 sigma of the estimated position of the rear-axle centre R.
"""

import numpy as np
import rerun as rr
from rerun.components import FillMode, RotationQuatBatch, Translation3DBatch

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.plants.mujoco.clearance import quat_of
from agrobot_mj.plants.scene import Scene
from agrobot_mj.recording.transport.timeline import Times, data_column, send
from agrobot_mj.recording.world.events import Events
from agrobot_mj.recording.world.ground import on_ground, slopes
from agrobot_mj.recording.world.names import TrackNames
from agrobot_mj.recording.world.ruts import send_ruts
from agrobot_mj.recording.world.tracks import TRACKS, Tracks
from agrobot_mj.recording.world.trail import Trail
from agrobot_mj.recording.world.wheels import Forces, Wheels
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log, Rows
from agrobot_mj.terrain import Ground

BELIEF = "world/belief"
SIGMAS = 3.0
COLOUR, LIFT_M, WIDTH = 0xFFC857FF, 0.03, rr.Radius.ui_points(1.25)
THICKNESS_M, REACH_M = 1e-3, 0.2


class Belief:
    """Recorder that sends an uncertainty ellipse of the estimated position in each tick."""

    def __init__(self, rows: Rows, ground: Ground) -> None:
        self.rows, self.ground = rows, ground

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Send the ellipses of the log rows from `first`; `times` (n,) are the times of the rows."""
        if first == 0:
            style = rr.Ellipsoids3D.from_fields(colors=COLOUR, line_radii=WIDTH, fill_mode=FillMode.MajorWireframe)
            stream.log(BELIEF, style, static=True)
        names = ("rear_x_hat", "rear_y_hat", "p_xx", "p_xy", "p_yy")
        x, y, *p = (self.rows.column(name, first)[: len(times)] for name in names)
        there = np.isfinite([x, y, *p]).all(axis=0)
        if not there.any():
            return
        centres = on_ground(self.ground, np.column_stack([x, y])[there], LIFT_M)
        axes, frames = ellipses(*(v[there] for v in p))
        tilted = _rotations_to_ground(frames, *slopes(self.ground, x[there], y[there], REACH_M))
        quaternions = np.array([quat_of(rotation) for rotation in tilted])
        shapes = rr.Ellipsoids3D.columns(
            centers=centres.astype(np.float32),
            half_sizes=np.column_stack([SIGMAS * axes, np.full(len(axes), THICKNESS_M)]).astype(np.float32),
            quaternions=quaternions[:, [1, 2, 3, 0]].astype(np.float32),
        )
        send(stream, BELIEF, times[there], shapes)


def ellipses(p_xx: Array, p_xy: Array, p_yy: Array) -> tuple[Array, Array]:
    """Return the 1 sigma semi-axes (n, 2) [m] and the directions of the first axes (n, 2) of covariance ellipses."""
    p = np.stack([p_xx, p_xy, p_xy, p_yy], axis=-1).reshape(-1, 2, 2)
    variances, directions = np.linalg.eigh(p)
    return np.sqrt(np.maximum(variances, 0.0)), directions[:, :, 0]


def _rotations_to_ground(axis: Array, dx: Array, dy: Array) -> Array:
    """Return rotation matrices (n, 3, 3) that align a plane with the ground, whose slopes are `dx`, `dy` (n,) [-]. Seen
    from above, the first axis of the plane has the direction `axis` (n, 2)."""
    first = np.column_stack([axis, axis[:, 0] * dx + axis[:, 1] * dy])
    normal = np.column_stack([-dx, -dy, np.ones(len(dx))])
    first, normal = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (first, normal))
    return np.stack([first, np.cross(normal, first), normal], axis=2)


FARTHEST_M = 1e6
"""Maximum distance of recorded bodies from the origin [m]. At this distance, the viewer has a resolution of 6 cm."""
PLACE, ATTITUDE = rr.Transform3D.descriptor_translation(), rr.Transform3D.descriptor_quaternion()


class BodyMotion:
    """Recorder that sends all moving content of the scene, up to the first invalid pose."""

    def __init__(self, rows: Rows, scene: Scene, ground: Ground, scenario: Scenario, reference: Array) -> None:
        self.rows, self.scene, self.ground, self.last = rows, scene, ground, -1
        self.events = Events(rows, ground, scenario.fault, scenario.tractor.size)
        self.parts: list[Tracks | TrackNames | Belief | Forces | Trail | Events] = [
            *(Tracks(rows, ground), TrackNames(rows, ground, scenario, reference), Belief(rows, ground), self.events)
        ]
        self.trail = None
        if "load_fl" in rows.columns:
            wheels = Wheels(rows, scene, ground)
            self.trail = Trail(wheels, scenario.ticks)
            self.parts += [Forces(wheels, scenario.tractor), self.trail]

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Send the log rows from `first` up to the last valid row. `times` (n,) are the times of the rows."""
        places = [self.rows.column(name, first) for track in TRACKS for name in (track.x, track.y)]
        times = times[: sound_rows(self.rows.poses[first : self.rows.filled], *places)]
        if not times.size or first != self.last + 1:
            return
        for i, body in enumerate(self.scene.bodies):
            pose = self.rows.poses[first : first + len(times), i]
            columns = (
                data_column(PLACE, Translation3DBatch(pose[:, :3])),
                data_column(ATTITUDE, RotationQuatBatch(pose[:, [4, 5, 6, 3]])),
            )
            send(stream, f"world/bodies/{body}", times, columns)
        for part in self.parts:
            part.send(stream, times, first)
        self.last = first + len(times) - 1

    def finish(self, stream: rr.RecordingStream, log: Log) -> None:
        """Send the content of a finished run: last tyre marks, outcome and ruts."""
        if self.last < 0:
            return
        if self.trail:
            self.trail.finish(stream, self.last)
        self.events.finish(stream, log.outcome, self.last)
        if log.ruts is not None:
            wheels = [self.scene.bodies.index(f"wheel_{wheel}") for wheel in WHEELS]
            send_ruts(stream, log.ruts, self.ground, log.column("t"), log.poses[:, wheels, :2])


def sound_rows(poses: Array, *more: Array) -> int:
    """Return the number of rows before the first invalid value in `poses` (n, bodies, 7) or in the arrays `more`
    (n,)."""
    table = np.column_stack([poses.reshape(len(poses), -1), *more])
    there = (np.abs(table) < FARTHEST_M).all(axis=1)  # False for NaN
    return len(table) if there.all() else int(there.argmin())
