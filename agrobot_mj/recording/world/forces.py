"""Tyre forces as arrows beside the wheels: along the ground coloured by the friction in use, and the load.

A force comes out from under the tyre to the side to which it points, the load stands outside the tyre: neither hides
below it. Without wheels in the log there are none.
"""

import numpy as np
import rerun as rr

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.machine.tractor import COMPACT, TractorParameters
from agrobot_mj.recording.transport.timeline import Index, Times, send
from agrobot_mj.recording.world.colours import ramp
from agrobot_mj.recording.world.wheels import Wheels

M_PER_N, LOAD_M_PER_N, THICK_M, THIN_M = 1 / 1000, 1 / 2000, 0.03, 0.014
"""Length of the arrows for the default tractor: forces along the ground are the smaller ones. Those of others are as
long for the same share of the weight, times the tractor's size."""
BESIDE_M, LIFT_M, FOOT = 0.05, 0.05, 0.5
"""Start of an arrow outside the tyre and above the ground [m]; half length of its footprint over its radius [-]."""
OUTWARD = np.array([1.0 if wheel.endswith("l") else -1.0 for wheel in WHEELS])
FORCES, LOADS = "world/forces/ground", "world/forces/load"
LOAD_COLOUR = 0xC3B5F0FF
USE_COLOURS = ((0.0, 0x4DF08AFF), (0.6, 0xFFC400FF), (0.95, 0xE02010FF))
"""Share of the friction in use and the colour from there on."""
UNKNOWN_USE = 0.0


class Forces:
    """Sends the arrows of every tick."""

    def __init__(self, wheels: Wheels, tractor: TractorParameters) -> None:
        self.wheels, self.size = wheels, tractor.size
        self.scale = tractor.size * COMPACT.mass_kg / tractor.mass_kg

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Rows from `first` on, at `times` (n,)."""
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
        """Start and arrow of the forces along the ground, then of the loads, at rows `at` (n,), each (n, 4, 3) [m]."""
        contacts = self.wheels.contacts(at)
        fx, fy, load = (np.nan_to_num(self.wheels.report(name, at))[..., None] for name in ("fx", "fy", "load"))
        along = fx * contacts.forward + fy * contacts.left
        beside = self.wheels.half_widths[:, None] + BESIDE_M
        size = np.maximum(np.hypot(fx / (FOOT * self.wheels.radii[:, None]), fy / beside), 1e-9)
        ground = contacts.patch + LIFT_M * contacts.normal
        outside = ground + OUTWARD[:, None] * beside * contacts.left
        ahead, up = M_PER_N * self.scale * along, LOAD_M_PER_N * self.scale * load * contacts.normal
        return ground + along / size, ahead, outside, up
