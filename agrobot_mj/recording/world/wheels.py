"""Where the wheels stand: the patch of each, and the frame in which the log has its forces."""

from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.plants.scene import Scene
from agrobot_mj.recording.transport.timeline import Index
from agrobot_mj.recording.world.ground import slopes
from agrobot_mj.simulation.log import Rows
from agrobot_mj.terrain import Ground

REACH_M = 0.01
"""Half the distance over which the ground's slope is taken [m]."""


class WheelContacts(NamedTuple):
    """Four wheels, fl, fr, rl, rr, at n times; vectors of the world, shape (n, 4, 3)."""

    patch: Array
    """The lowest point of the tyre's middle [m]."""
    forward: Array
    """Direction of rolling, in the plane of the ground."""
    left: Array
    normal: Array
    """Normal of the ground below the wheel's centre."""


class Wheels:
    """The wheels of a run."""

    def __init__(self, rows: Rows, scene: Scene, ground: Ground) -> None:
        self.rows, self.ground = rows, ground
        self.bodies = np.array([scene.bodies.index(f"wheel_{wheel}") for wheel in WHEELS])
        sizes = {geom.name: geom.size for geom in scene.geoms}
        self.radii = np.array([sizes[f"tyre_{wheel}"][0] for wheel in WHEELS])
        """Radii of the tyres [m]."""
        self.half_widths = np.array([sizes[f"tyre_{wheel}"][1] for wheel in WHEELS])
        """Half widths of the tyres [m]."""

    def contacts(self, at: Index) -> WheelContacts:
        """Contacts at the rows `at` (n,)."""
        return contacts(self.ground, self.rows.poses[np.ix_(at, self.bodies)], self.radii)

    def report(self, quantity: str, at: Index) -> Array:
        """A quantity of the log's wheels at the rows `at` (n,), shape (n, 4)."""
        columns = np.array([self.rows.columns.index(f"{quantity}_{wheel}") for wheel in WHEELS])
        found: Array = self.rows.values[np.ix_(at, columns)]
        return found


def contacts(ground: Ground, poses: Array, radii: Array) -> WheelContacts:
    """Contacts from the wheels' poses (n, 4, 7) and radii (4,) [m], as in `tyres.patch.find_patch`."""
    centre = poses[..., :3]
    w, x, y, z = np.moveaxis(poses[..., 3:], -1, 0)
    axle = np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], axis=-1)
    dx, dy = slopes(ground, centre[..., 0], centre[..., 1], REACH_M)
    normal = _unit(np.stack([-dx, -dy, np.ones(dx.shape)], axis=-1))
    forward = _unit(np.cross(axle, normal))
    tilt = (normal * axle).sum(axis=-1, keepdims=True)
    patch = centre + radii[:, None] * _unit(tilt * axle - normal)
    return WheelContacts(patch, forward, np.cross(normal, forward), normal)


def _unit(v: Array) -> Array:
    found: Array = v / np.linalg.norm(v, axis=-1, keepdims=True)
    return found
