"""Interface of a plant (simulated tractor) in a run, and division of a tick into physics steps."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import held
from agrobot_mj.core.signals import NOMINAL, TICK_S, Array, Column, Conditions, Drive, Reference, Truth
from agrobot_mj.plants.scene import Scene
from agrobot_mj.terrain.memory import AnyArray, RutMap


def copies(arrays: tuple[AnyArray, ...]) -> tuple[AnyArray, ...]:
    """Return a tuple with a copy of each array."""
    return tuple(array.copy() for array in arrays)


def write(arrays: tuple[AnyArray, ...], saved: tuple[AnyArray, ...]) -> None:
    """Overwrite arrays in place with saved arrays of the same shapes."""
    for array, values in zip(arrays, saved, strict=True):
        array[:] = values


class Clock(NamedTuple):
    """Duration of a physics step of a plant, and number of physics steps per tick."""

    dt: float = 0.002  # Duration of a physics step [s]
    steps: int = 25  # Number of physics steps per tick [-]

    @property
    def tick_s(self) -> float:
        """Duration of a tick [s]."""
        return self.steps * self.dt

    @classmethod
    def of(cls, dt: float, tick_s: float = TICK_S) -> "Clock":
        """Return a clock for ticks of `tick_s` [s], each divided into physics steps of `dt` [s]."""
        return cls(dt, round(tick_s / dt))


class RunningPlant(Protocol):
    """Interface of a plant (simulated tractor) in a run. Subclasses may omit methods with a default implementation."""

    scene: Scene

    def reset(self, start: Reference, conditions: Conditions = NOMINAL) -> Truth:
        """Place the tractor at rest at the start of the path; return its true state under the `conditions` of tick
        0."""

    def advance(self, drive: Drive, conditions: Conditions = NOMINAL) -> Truth:
        """Simulate one tick at constant valve voltages and conditions; return the true state at the end of the tick."""

    def advanced(self, drive: Drive, conditions: Conditions = NOMINAL) -> Held[Truth]:
        """Simulate one tick as in `advance`; return a `Held` reference to the true state, which saves time."""
        return held(self.advance(drive, conditions))

    def save(self) -> Any:
        """Return a copy of the complete state of the plant, for the method `restore`."""

    def restore(self, state: Any) -> None:
        """Restore a state saved by this plant or by another plant with the same parameters."""

    def poses(self) -> Array:
        """Return the ENU position x y z [m] and quaternion w x y z of every body, shape (bodies, 7)."""

    def configuration(self) -> Array:
        """Return MuJoCo's generalised positions (`qpos`) of the tractor, shape (nq,)."""

    def wheels(self) -> Array:
        """Return the six tyre quantities (see `tyres.patch`) of four wheels, shape (24,), or an empty array without
        tyres."""
        return np.empty(0)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns that only this plant has, in addition to the columns of every run."""
        return ()

    def report(self) -> Sequence[float]:
        """Return the current values of the log columns `columns`, in the same order."""
        return ()

    def actuation(self) -> tuple[float, float, float]:
        """Return the steering oil flow [m3/s], the cylinder pressure [Pa] and the torque on the driven wheels [N m].

        Quantities that the plant does not model are NaN.
        """

    def ruts(self) -> RutMap | None:
        """Return the ruts on the field, or None if the ground has no plastic soil."""
        return None

    def warnings(self) -> int:
        """Return the number of warnings of the physics engine since the reset."""
        return 0

    def trouble(self) -> str | None:
        """Return the outcome that ends the run, such as `rolled_over`, or None if the run continues."""
