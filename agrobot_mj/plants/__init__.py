"""Plants (simulated tractors) with a common interface: the bicycle model of [Kayacan2015] and the MuJoCo tractor."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.plants.base import Clock, RunningPlant
from agrobot_mj.plants.bicycle import Bicycle, BicyclePlant
from agrobot_mj.plants.mujoco.build import Mujoco
from agrobot_mj.plants.mujoco.plant import MujocoPlant

Plant = Annotated[
    Bicycle
    | Mujoco,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = ["Bicycle", "BicyclePlant", "Clock", "Mujoco", "MujocoPlant", "Plant", "RunningPlant"]
