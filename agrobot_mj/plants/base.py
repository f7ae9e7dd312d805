"""The contract of a running plant, and the clock that it keeps."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from agrobot_mj.core.signals import NOMINAL, TICK_S, Array, Column, Conditions, Drive, Reference, Truth
from agrobot_mj.plants.scene import Scene
from agrobot_mj.terrain.memory import AnyArray, RutMap


def copies(arrays: tuple[AnyArray, ...]) -> tuple[AnyArray, ...]:
    """Return the copies of the arrays."""
    return tuple(array.copy() for array in arrays)


def write(arrays: tuple[AnyArray, ...], saved: tuple[AnyArray, ...]) -> None:
    """Write saved values into arrays of the same shapes."""
    for array, values in zip(arrays, saved, strict=True):
        array[:] = values


class Clock(NamedTuple):
    """Time steps of a plant."""

    dt: float = 0.002
    """Physics step [s]."""
    steps: int = 25
    """Physics steps per tick [-]."""

    @property
    def tick_s(self) -> float:
        """Duration of a tick [s]."""
        return self.steps * self.dt

    @classmethod
    def of(cls, dt: float, tick_s: float = TICK_S) -> "Clock":
        """Return the clock whose ticks of `tick_s` consist of steps of `dt` [s]."""
        return cls(dt, round(tick_s / dt))


class RunningPlant(Protocol):
    """Interface of a plant to the tick; a plant may omit optional parts."""

    scene: Scene

    def reset(self, start: Reference, conditions: Conditions = NOMINAL) -> Truth:
        """Place the tractor at rest at the start of the path, under the conditions of the first tick."""

    def advance(self, drive: Drive, conditions: Conditions = NOMINAL) -> Truth:
        """Advance one tick at constant voltages and conditions; return the true state."""

    def save(self) -> Any:
        """Return the state between two ticks, as values that no later tick changes."""

    def restore(self, state: Any) -> None:
        """Go on from a state that this plant, or another of the same parameters, has saved."""

    def poses(self) -> Array:
        """Return the pose of every body, shape (bodies, 7): x y z, quaternion w x y z."""

    def configuration(self) -> Array:
        """Return the generalised positions of the tractor of `models/tractor.xml`, shape (nq,)."""

    def wheels(self) -> Array:
        """Return the reports of the four wheels; an empty array without wheels."""
        return np.empty(0)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Further signals that the plant reports."""
        return ()

    def report(self) -> Sequence[float]:
        """Return the values of `columns`."""
        return ()

    def actuation(self) -> tuple[float, float, float]:
        """Return the oil flow to the cylinder [m3/s], its pressure [Pa] and the torque on the driven wheels [N m], or
        NaN."""

    def ruts(self) -> RutMap | None:
        """Return the ruts on the field; None on ground that does not remember."""
        return None

    def warnings(self) -> int:
        """Number of physics warnings since the reset."""
        return 0

    def trouble(self) -> str | None:
        """Return an outcome that ends the run, or None."""
