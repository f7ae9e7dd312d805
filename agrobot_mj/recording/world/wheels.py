"""Contact frames of the wheels, in which wheel forces are logged, and force arrows next to the wheels.

The arrow of the force in the ground plane starts at the edge of the footprint. Its colour indicates the friction
utilisation. The arrow of the load starts outside the tyre. A run without wheels has no arrows.
"""

from typing import NamedTuple

import numpy as np
import rerun as rr

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.machine.tractor import COMPACT, TractorParameters
from agrobot_mj.plants.scene import Scene
from agrobot_mj.recording.transport.timeline import Index, Times, send
from agrobot_mj.recording.world.colours import ramp
from agrobot_mj.recording.world.ground import slopes
from agrobot_mj.simulation.log import Rows
from agrobot_mj.terrain import Ground

REACH_M = 0.01  # Half of the distance over which ground slopes are computed [m]


class WheelContacts(NamedTuple):
    """Contact points and axes of the wheels fl, fr, rl, rr at n times, as vectors in world axes with the shape (n, 4,
    3)."""

    patch: Array  # Lowest point of the wheel plane (central plane of the tyre) [m]
    forward: Array  # Rolling direction, parallel to the ground
    left: Array
    normal: Array  # Normal of the ground below the wheel centre


class Wheels:
    """Geometry and logged quantities of the wheels of a run."""

    def __init__(self, rows: Rows, scene: Scene, ground: Ground) -> None:
        self.rows, self.ground = rows, ground
        self.bodies = np.array([scene.bodies.index(f"wheel_{wheel}") for wheel in WHEELS])
        sizes = {geom.name: geom.size for geom in scene.geoms}
        self.radii = np.array([sizes[f"tyre_{wheel}"][0] for wheel in WHEELS])
        """Radii of the tyres [m]."""
        self.half_widths = np.array([sizes[f"tyre_{wheel}"][1] for wheel in WHEELS])
        """Half widths of the tyres [m]."""

    def contacts(self, at: Index) -> WheelContacts:
        """Return the wheel contacts in the log rows `at` (n,)."""
        return contacts(self.ground, self.rows.poses[np.ix_(at, self.bodies)], self.radii)

    def report(self, quantity: str, at: Index) -> Array:
        """Return the logged quantity `quantity` of the four wheels in the rows `at` (n,), shape (n, 4)."""
        columns = np.array([self.rows.columns.index(f"{quantity}_{wheel}") for wheel in WHEELS])
        found: Array = self.rows.values[np.ix_(at, columns)]
        return found


def contacts(ground: Ground, poses: Array, radii: Array) -> WheelContacts:
    """Return the contacts of wheels with poses (n, 4, 7) and radii (4,) [m], computed like `tyres.patch.find_patch`."""
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


M_PER_N, LOAD_M_PER_N, THICK_M, THIN_M = 1 / 1000, 1 / 2000, 0.03, 0.014
"""Scales of force arrows for the default tractor: length per ground force and per wheel load [m/N], radius for ground
force and for load [m]. Arrows of other tractors scale with tractor size, and their lengths also with tractor weight."""
BESIDE_M, LIFT_M, FOOT = 0.05, 0.05, 0.5
"""Distance of arrows from the tyre [m], height of arrows [m], and half the footprint length divided by the wheel radius
[-]."""
OUTWARD = np.array([1.0 if wheel.endswith("l") else -1.0 for wheel in WHEELS])
FORCES, LOADS = "world/forces/ground", "world/forces/load"
LOAD_COLOUR = 0xC3B5F0FF
USE_COLOURS = ((0.0, 0x4DF08AFF), (0.6, 0xFFC400FF), (0.95, 0xE02010FF))
"""Pairs of friction utilisation [-] and colour 0xRRGGBBAA."""
UNKNOWN_USE = 0.0


class Forces:
    """Recorder that sends the forces on the wheels in each tick as arrows."""

    def __init__(self, wheels: Wheels, tractor: TractorParameters) -> None:
        self.wheels, self.size = wheels, tractor.size
        self.scale = tractor.size * COMPACT.mass_kg / tractor.mass_kg

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Send the force arrows of the log rows from `first`. `times` (n,) are the times of the rows."""
        if first == 0:
            stream.log(FORCES, rr.Arrows3D.from_fields(radii=THICK_M * self.size), static=True)
            stream.log(LOADS, rr.Arrows3D.from_fields(radii=THIN_M * self.size, colors=LOAD_COLOUR), static=True)
        at = first + np.arange(len(times))
        counts = np.full(len(times), len(WHEELS))
        starts, along, posts, up = (v.reshape(-1, 3).astype(np.float32) for v in self.arrows(at))
        use = np.nan_to_num(self.wheels.report("friction_use", at), nan=UNKNOWN_USE)
        forces = rr.Arrows3D.columns(origins=starts, vectors=along, colors=ramp(USE_COLOURS, use.ravel()))
        send(stream, FORCES, times, forces.partition(counts))
        send(stream, LOADS, times, rr.Arrows3D.columns(origins=posts, vectors=up).partition(counts))

    def arrows(self, at: Index) -> tuple[Array, Array, Array, Array]:
        """Return origins and vectors of the arrows in the log rows `at` (n,): first ground forces, then wheel loads.

        All four arrays have the shape (n, 4, 3) [m].
        """
        contacts = self.wheels.contacts(at)
        fx, fy, load = (np.nan_to_num(self.wheels.report(name, at))[..., None] for name in ("fx", "fy", "load"))
        along = fx * contacts.forward + fy * contacts.left
        beside = self.wheels.half_widths[:, None] + BESIDE_M
        size = np.maximum(np.hypot(fx / (FOOT * self.wheels.radii[:, None]), fy / beside), 1e-9)
        ground = contacts.patch + LIFT_M * contacts.normal
        outside = ground + OUTWARD[:, None] * beside * contacts.left
        ahead, up = M_PER_N * self.scale * along, LOAD_M_PER_N * self.scale * load * contacts.normal
        return ground + along / size, ahead, outside, up
