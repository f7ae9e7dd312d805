"""What a scenario says of the MuJoCo tractor, `[plant] kind = "mujoco"`."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.spec import Spec
from agrobot_mj.machine import Machine
from agrobot_mj.plants.mujoco.build import doubts
from agrobot_mj.tyres import MagicFormula, Tyre


class Mujoco(Spec):
    """The MJCF tractor on its tyres."""

    kind: Literal["mujoco"] = "mujoco"
    tyre: Tyre = MagicFormula()
    """Law of the tyres, `plant.tyre.kind`."""
    settle_s: Annotated[float, Field(ge=0, le=120)] = 3.0
    """Least time on the tyres before the run starts, at rest at its end; 0 starts it where it is placed [s]."""
    settle_limit_s: Annotated[float, Field(ge=0, le=600)] = 60.0
    """Time after which a tractor that is not at rest starts as it is, with a message [s]. Estimate."""

    def doubts(self, machine: Machine, speed: float) -> Iterator[str]:
        """Parts of a machine that do not fit its weight at the path's `speed` [m/s]: lines that begin with a key."""
        return doubts(self.tyre, machine, speed)

    @property
    def fast_step_s(self) -> float:
        """Physics step of `physics = "fast"` [s]."""
        return self.tyre.fast_step_s
