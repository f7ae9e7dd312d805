"""Clutches of the front-wheel drive and differential lock, which engage and release in a run, at most once per tick.

In MuJoCo an engaged clutch couples two angles. When a clutch engages, the offset of its coupling is set to the current
angles to avoid a jump.
"""

from math import degrees

import mujoco

from agrobot_mj.core.signals import Array
from agrobot_mj.machine import Machine
from agrobot_mj.plants.base import TractorMotion

CLOSES_BELOW_DEG = 3.0
"""Steering angle at release of a clutch minus steering angle at its engagement [deg]. Assumed value (range 2-5)."""
RELEASES_AT = 0.5
"""Slip at release of the front-wheel drive divided by slip at its engagement [-]. Assumed value (range 0.3-0.7)."""
LEAST_M_S = 0.1  # Rim speed below which slip is not evaluated [m/s]
LOCK, FRONT = "differential_lock", "front_wheel_drive"


class Clutches:
    """Clutches of a tractor in a run. Their state is `eq_active` in MjData and the offsets of the couplings."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, machine: Machine) -> None:
        self.model, self.data, self.drive = model, data, machine.driveline
        rear = machine.tractor.rear_wheel
        self.rolling_radius = rear.radius - rear.deflection / 3
        self.switched = any(
            angle is not None
            for angle in (self.drive.front_release_deg, self.drive.front_engage_slip, self.drive.lock_release_deg)
        )
        self.ids = {name: model.equality(name).id for name in (LOCK, FRONT)}
        self.angles = {wheel: int(model.joint(f"spin_{wheel}").qposadr[0]) for wheel in ("fl", "fr", "rl", "rr")}

    @property
    def memories(self) -> tuple[Array, ...]:
        """Offset of each coupling [rad], shape (1,), modified in place; empty if no clutch switches during a run."""
        return tuple(self.model.eq_data[i, :1] for i in self.ids.values()) if self.switched else ()

    def reset(self) -> None:
        """Set the angular offsets of the couplings to zero."""
        for offset in self.memories:
            offset[:] = 0.0

    def update(self, motion: TractorMotion) -> None:
        """Engage or release each clutch according to the current steering angle and slip."""
        steer, drive = abs(degrees(motion.steer)), self.drive
        if drive.differential_lock:
            self._set(LOCK, self._straight(LOCK, steer, drive.lock_release_deg))
        if drive.front_wheel_drive:
            straight = self._straight(FRONT, steer, drive.front_release_deg)
            self._set(FRONT, straight and self._slips(motion, drive.front_engage_slip))

    def is_engaged(self, name: str) -> bool:
        """Return whether the clutch `name` is engaged."""
        return bool(self.data.eq_active[self.ids[name]])

    def _straight(self, name: str, steer: float, release: float | None) -> bool:
        if release is None:
            return True
        return steer <= (release if self.is_engaged(name) else max(release - CLOSES_BELOW_DEG, 0.5 * release))

    def _slips(self, motion: TractorMotion, engage: float | None) -> bool:
        if engage is None:
            return True
        rim = motion.spin * self.rolling_radius
        slip = 0.0 if abs(rim) < LEAST_M_S else 1.0 - motion.speed / rim
        return slip >= (RELEASES_AT * engage if self.is_engaged(FRONT) else engage)

    def _set(self, name: str, closed: bool) -> None:
        if closed == self.is_engaged(name):
            return
        i, data = self.ids[name], self.model.eq_data
        if closed:
            fl, fr, rl, rr = (float(self.data.qpos[at]) for at in self.angles.values())
            first, second = (rl, rr) if name == LOCK else (0.5 * (fl + fr), 0.5 * (rl + rr))
            data[i, 0] = first - data[i, 1] * second
        self.data.eq_active[i] = closed
