"""Interface of a plant (simulated tractor) in a run, and division of a tick into physics steps."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import cos, radians
from types import GenericAlias
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.calls import address_of
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import bound, fetched, shared
from agrobot_mj.core.signals import NEUTRAL_V, NOMINAL, TICK_S, Column, Conditions, Drive, Matrix, Reference, Truth
from agrobot_mj.core.vectors import Vector
from agrobot_mj.plants.mujoco.c_api import fail
from agrobot_mj.plants.mujoco.implement import COLUMNS
from agrobot_mj.plants.scene import Scene
from agrobot_mj.terrain import Ground
from agrobot_mj.terrain.memory import AnyArray, RutMap

ROLLOVER_COSINE = cos(radians(60))
"""Cosine of the tilt angle above which the tractor has rolled over [-]. Assumed value, beyond all tip-over angles."""
DIVERGED_SPEED = 100.0  # Speed above which the simulation has diverged [m/s]. Assumed value.
Report: Any = GenericAlias(tuple, (float,) * len(COLUMNS))  # Type of the log values of an implement


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


class Motion(NamedTuple):
    """Position and velocity of a point in ENU coordinates."""

    place: tuple[float, float, float]  # Position of the point, ENU [m]
    velocity: tuple[float, float, float]  # Velocity of the point, ENU [m/s]


class TractorMotion(NamedTuple):
    """Motion of the tractor after a step. `Truth` documents the fields that have no comment here."""

    cg: Motion
    antenna: Motion
    rear: Motion
    attitude: Vector  # Yaw, pitch and roll of the chassis [rad]
    speed: float
    lateral_speed: float
    yaw_rate: float
    body_rates: Vector
    steer: float
    pedal: float
    spin: float  # Mean angular velocity of the rear wheels [rad/s]
    actuation: Vector
    """Steering oil flow [m3/s], steering cylinder pressure [Pa] and torque on the driven wheels [N m]."""
    fastest: float  # Maximum velocity component of CG and antenna [m/s], or infinity if the motion is not finite
    lean_cosine: float
    """Cosine of the maximum angle between the vertical and the upward axes of chassis and implement [-]."""
    folded: bool  # Whether the drawbar of the implement is at its stop


class PlantCode(NamedTuple):
    """Plant for ticks that run in compiled code: addresses of its functions, and arrays that they modify in place."""

    steps: int  # Address of the function that performs the physics steps, see `steps_form`
    look: int  # Address of the function that returns the true state, see `look_form`
    report: int  # Address of the function that returns the log values of the implement, or 0 without an implement
    rig: Held[Any]  # Parameters and state of the plant
    extent: tuple[float, float, float, float]  # Range of x and y of the ground [m]
    wheels: Matrix  # Tyre quantities (see `tyres.patch`) of the wheels, shape (4, 6), or (0, 6) without tyres
    positions: Matrix  # Positions of the bodies, as in MjData
    quaternions: Matrix  # Quaternions of the bodies, as in MjData


def steps_form(rig: Held[Any], voltages: tuple[float, float], first: int, clear: bool) -> tuple[bool, bool]:
    """Define the signature of `run_steps` for compiled calls. The function itself is never called."""
    raise NotImplementedError


def look_form(rig: Held[Any], t: float) -> tuple[Held[Truth], TractorMotion]:
    """Define the signature of `look` for compiled calls. The function itself is never called."""
    raise NotImplementedError


def report_form(rig: Held[Any]) -> Report:
    """Define the signature of compiled functions that return log values. The function itself is never called."""
    raise NotImplementedError


TROUBLES = None, "diverged", "rolled_over", "jackknifed", "left_terrain"  # Outcomes that end a run


@shared
def trouble_of(m: TractorMotion, extent: tuple[float, float, float, float]) -> int:
    """Return the index in `TROUBLES` for a motion of the tractor on a ground with the range `extent` of x and y [m]."""
    if m.fastest > DIVERGED_SPEED:
        return 1
    if m.lean_cosine < ROLLOVER_COSINE:
        return 2
    x, y, (x_min, x_max, y_min, y_max) = m.cg.place[0], m.cg.place[1], extent
    return 3 if m.folded else 0 if x_min <= x <= x_max and y_min <= y <= y_max else 4


REST = NEUTRAL_V, NEUTRAL_V  # Voltages of both valves in neutral [V]


class RunningPlant(ABC):
    """Plant (simulated tractor) in a run.

    The compiled functions of a subclass have the signatures `steps_form`, `look_form` and, with an implement,
    `report_form`. These functions use the parameters and the state in `rig`.
    """

    scene: Scene
    ground: Ground
    samples: Matrix  # Steering angle, pedal, and angles of both knuckles after each step of the last tick, shape (4, n)
    rig: Held[Any]
    seen: Held[Truth]  # True state at the end of the last tick
    motion: TractorMotion  # Motion at the end of the last tick
    clear: bool  # Whether the body is too high above the ground for contacts
    ticks: int  # Number of ticks since the reset
    tick_s: float  # Duration of a tick [s]
    conditions: Conditions  # Conditions of the last tick
    braking: float  # Applied fraction of the brake torque [-]

    def _compile(self, shown: tuple[AnyArray, Any, Any], *functions: Any) -> None:
        """Compile the functions of the plant, in the order of their forms. `shown` contains arrays of `PlantCode`."""
        self._shown, self._functions, self._places = shown, functions, list[int]()
        self._run, self._observe = bound(functions[0], self.rig, REST, 0, False), bound(functions[1], self.rig, 0.0)
        self._reported = bound(functions[2], self.rig) if functions[2:] else None

    @abstractmethod
    def reset(self, start: Reference, conditions: Conditions = NOMINAL) -> Truth:
        """Place the tractor at rest at the start of the path; return its true state under the `conditions` of tick
        0."""

    def advance(self, drive: Drive, conditions: Conditions = NOMINAL) -> Truth:
        """Simulate one tick at constant valve voltages and conditions; return the true state at the end of the tick."""
        return fetched(self.advance_held(drive, conditions))

    def advance_held(self, drive: Drive, conditions: Conditions = NOMINAL) -> Held[Truth]:
        """Simulate one tick as in `advance`; return a `Held` reference to the true state, which saves time."""
        if conditions != self.conditions:
            self._apply_conditions(conditions)
        self.step_through(drive)
        self.ticks += 1
        self._look()
        return self.seen

    def step_through(self, drive: Drive) -> None:
        """Simulate the physics steps of one tick at constant valve voltages, without computing the true state."""
        self.braking, voltages = drive.brake, (drive.steer_voltage, drive.powered_pedal)
        done, self.clear = self._run(self.rig, voltages, 0, self.clear)
        if not done:
            fail()

    @abstractmethod
    def _apply_conditions(self, conditions: Conditions) -> None:
        """Set the conditions of the next tick."""

    def _update_bodies(self) -> None:
        """Compute body poses from the generalised positions, and test whether the chassis is clear of the ground."""
        _, self.clear = self._run(self.rig, REST, self.samples.shape[1], False)

    def _look(self) -> None:
        self.seen, self.motion = self._observe(self.rig, self.ticks * self.tick_s)

    def code(self) -> PlantCode | None:
        """Return the data for ticks that run in compiled code, or None if ticks need Python."""
        if not self._places:
            given = (self.rig, REST, 0, False), (self.rig, 0.0), (self.rig,)
            forms = zip(self._functions, (steps_form, look_form, report_form), given, strict=False)
            self._places = [address_of(function, form, *arguments) for function, form, arguments in forms]
        steps, look, report = (*self._places, 0)[:3]
        return PlantCode(steps, look, report, self.rig, self.ground.extent, *self._shown)

    def resume(self, truth: Held[Truth], motion: TractorMotion, clear: bool, ticks: int) -> None:
        """Store the results of ticks that ran in compiled code: true state, motion, ground clearance, and number of
        ticks."""
        self.seen, self.motion, self.clear, self.ticks = truth, motion, clear, ticks

    @abstractmethod
    def save(self) -> Any:
        """Return a copy of the complete state of the plant, for the method `restore`."""

    @abstractmethod
    def restore(self, state: Any) -> None:
        """Restore a state saved by this plant or by another plant with the same parameters."""

    def truth(self) -> Truth:
        """Return the true state of the tractor at the end of the last tick."""
        self._look()
        return fetched(self.seen)

    def poses(self) -> AnyArray:
        """Return the ENU position x y z [m] and quaternion w x y z of every body, shape (bodies, 7)."""
        return np.concatenate(self._shown[1:], axis=1)

    @abstractmethod
    def configuration(self) -> AnyArray:
        """Return MuJoCo's generalised positions (`qpos`) of the tractor, shape (nq,)."""

    def wheels(self) -> AnyArray:
        """Return the six tyre quantities (see `tyres.patch`) of four wheels, shape (24,), or an empty array without
        tyres."""
        return self._shown[0].T.ravel()

    @property
    def wheel_signals(self) -> int:
        """Number of values that `wheels` returns."""
        return int(self._shown[0].size)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the implement, or an empty tuple without an implement."""
        return COLUMNS if self._reported else ()

    def report(self) -> Sequence[float]:
        """Return the current values of the log columns `columns`, in the same order."""
        return self._reported(self.rig) if self._reported else ()

    def actuation(self) -> tuple[float, float, float]:
        """Return the steering oil flow [m3/s], the cylinder pressure [Pa] and the torque on the driven wheels [N m].

        Quantities that the plant does not model are NaN.
        """
        return self.motion.actuation

    def ruts(self) -> RutMap | None:
        """Return the ruts on the field, or None if the ground has no plastic soil."""
        return None

    def warnings(self) -> int:
        """Return the number of warnings of the physics engine since the reset."""
        return 0

    def trouble(self) -> str | None:
        """Return the outcome that ends the run (rolled_over, jackknifed, left_terrain or diverged), or None."""
        return TROUBLES[trouble_of(self.motion, self.ground.extent)]
