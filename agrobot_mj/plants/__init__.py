"""The plants: the paper's bicycle and the MuJoCo tractor, behind the same few methods."""

from typing import Annotated, Protocol

from pydantic import Field

from agrobot_mj.core.signals import NOMINAL, Array, Conditions, Drive, Reference, Truth
from agrobot_mj.plants.bicycle import Bicycle, BicyclePlant
from agrobot_mj.plants.mujoco.plant import Mujoco, MujocoPlant
from agrobot_mj.plants.scene import Scene

Plant = Annotated[Bicycle | Mujoco, Field(discriminator="kind")]


class RunningPlant(Protocol):
    """What the tick needs of a plant."""

    scene: Scene

    def reset(self, start: Reference, conditions: Conditions = NOMINAL) -> Truth:
        """Place the tractor at rest on the path's start, under the conditions of the first tick."""

    def advance(self, drive: Drive, conditions: Conditions = NOMINAL) -> Truth:
        """One tick under constant voltages and conditions."""

    def poses(self) -> Array:
        """Pose of every body, shape (bodies, 7): x y z, quaternion w x y z."""

    def wheels(self) -> Array:
        """What the four wheels report, or an empty array."""

    def actuation(self) -> tuple[float, float, float]:
        """Oil flow to the cylinder [m3/s], its pressure [Pa] and the torque on the driven wheels [N m], or NaN."""

    def warnings(self) -> int:
        """How often the physics warned since the reset."""

    def trouble(self) -> str | None:
        """An outcome that ends the run, or None."""


__all__ = ["Bicycle", "BicyclePlant", "Mujoco", "MujocoPlant", "Plant", "RunningPlant"]
