"""MuJoCo contact as a tyre model: friction under each wheel, and the same output quantities as the tyre laws."""

from math import atan2, hypot

import mujoco
import numpy as np

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.terrain import Ground, height_and_gradient
from agrobot_mj.terrain.grid import surface_at
from agrobot_mj.tyres.base import NativeContact
from agrobot_mj.tyres.laws import direction_of_travel
from agrobot_mj.tyres.patch import FORCE_X, FORCE_Y, FRICTION_USE, LOAD, SLIP_ANGLE, SLIP_RATIO, TyreSet


class NativeContacts:
    """Contacts of the four wheels in a model with MuJoCo contact."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, ground: Ground, tyres: TyreSet, native: NativeContact
    ) -> None:
        self.model, self.data, self.ground, self.tyres = model, data, ground, tyres
        self.friction, self.impratio = native
        self.bodies = [model.body(f"wheel_{wheel}").id for wheel in WHEELS]
        self.geoms = [model.geom(f"tyre_{wheel}").id for wheel in WHEELS]
        self.velocity = np.zeros(6)

    def set_friction(self) -> None:
        """Set the friction coefficient of each wheel geom, which overrides the ground geom, for the soil below."""
        for i, (body, geom) in enumerate(zip(self.bodies, self.geoms, strict=True)):
            x, y, _ = self.data.xpos[body]
            scale, _ = surface_at(self.ground.surface, x, y)
            self.model.geom_friction[geom, 0] = self.friction * scale * self.tyres.grip[i]

    def read(self, report: Array) -> None:
        """Write the tyre quantities to `report` (4, 6), from MuJoCo's contact sensors and the motion of the wheels."""
        for i, wheel in enumerate(WHEELS):
            forward, left, n = self._frame(self.bodies[i])
            force = self.data.sensor(f"contact_{wheel}").data[:3]
            force = force if force @ n >= 0 else -force
            load, f_x, f_y = force @ n, force @ forward, force @ left
            grip = self.model.geom_friction[self.geoms[i], 0] * load
            report[i, LOAD], report[i, FORCE_X], report[i, FORCE_Y] = load, f_x, f_y
            report[i, FRICTION_USE] = hypot(f_x, f_y) / grip if grip > 0 else 0.0
            report[i, SLIP_ANGLE], report[i, SLIP_RATIO] = self._slip(i, forward, left)

    def _frame(self, body: int) -> tuple[Array, Array, Array]:
        """Return unit vectors below a wheel: forward and left in the ground plane, and the ground normal."""
        _, dx, dy = height_and_gradient(self.ground, *self.data.xpos[body, :2])
        n = np.array([-dx, -dy, 1.0]) / hypot(dx, dy, 1.0)
        forward = np.cross(self._axle(body), n)
        forward /= np.linalg.norm(forward)
        return forward, np.cross(n, forward), n

    def _axle(self, body: int) -> Array:
        axle: Array = self.data.xmat[body].reshape(3, 3)[:, 1]
        return axle

    def _slip(self, i: int, forward: Array, left: Array) -> tuple[float, float]:
        body = self.bodies[i]
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_XBODY, body, self.velocity, 0)
        v_x, v_y = float(self.velocity[3:] @ forward), float(self.velocity[3:] @ left)
        rim = float(self.velocity[:3] @ self._axle(body)) * float(self.tyres.radius[i])
        driving = direction_of_travel(v_x, rim) * (rim - v_x)
        return atan2(v_y, max(abs(v_x), 1e-3)), driving / max(abs(v_x), abs(rim), 1e-3)
