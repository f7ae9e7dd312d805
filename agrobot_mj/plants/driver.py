"""Speed and steering controllers that use the true state, for plant tests without sensors and estimators."""

from collections.abc import Callable, Iterator
from math import copysign, cos
from typing import Any

import numpy as np

from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, Array, Drive, Reference, Truth
from agrobot_mj.machine import Machine
from agrobot_mj.plants import Clock, Mujoco, MujocoPlant
from agrobot_mj.terrain import Flat, Ground, Terrain

ORIGIN = Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
STOCK = Machine()
LEVEL = Flat()
Steer = float | Callable[[Truth], float]  # Steering angle [rad], or a function that computes the angle from the truth
FULL_SPEED = 5.0  # Speed of the default driveline at full pedal [m/s]
REST = Drive(NEUTRAL_V, NEUTRAL_V)
STEER_TOLERANCE = 2e-6  # Maximum steering error at which the valve remains in neutral [rad]


class Trace:
    """True states and tyre quantities of consecutive ticks."""

    def __init__(self, truths: list[Truth], wheels: list[Array]) -> None:
        self.truths, self._wheels = truths, wheels

    def __add__(self, later: "Trace") -> "Trace":
        return Trace(self.truths + later.truths, self._wheels + later._wheels)

    def __getitem__(self, name: str) -> Array:
        return np.array([getattr(truth, name) for truth in self.truths])

    @property
    def wheels(self) -> Array:
        """Tyre quantities with the axes tick, quantity (in the order of `tyres.patch`) and wheel, shape (n, 6, 4)."""
        return np.array(self._wheels).reshape(len(self._wheels), -1, 4)

    def mean(self, name: str, seconds: float) -> float:
        """Return the mean of the field `name` of `Truth` over the last `seconds` [s]."""
        return float(self[name][-round(seconds / TICK_S) :].mean())


class Driver:
    """Controller that uses the true state: PI control of the speed and proportional control of the steering angle."""

    def __init__(self, plant: Any, truth: Truth, speed: float = 0.0, full_speed: float = FULL_SPEED) -> None:
        self.plant, self.truth, self.speed, self.full_speed = plant, truth, speed, full_speed
        self.integral = 0.0

    def go(self, seconds: float, steer: Steer = 0.0) -> Trace:
        """Simulate for `seconds` [s] and return the `Trace`; `steer` is the setpoint [rad] or a function of the true
        state."""
        rule = steer if callable(steer) else lambda truth: steer
        return self._drive(seconds, lambda truth: self.steer_voltage(rule(truth)))

    def go_by_voltage(self, seconds: float, steer_voltage: float) -> Trace:
        """Simulate for `seconds` [s] at a constant steering valve voltage [V] and return the `Trace`."""
        return self._drive(seconds, lambda truth: steer_voltage)

    def pressures(self, seconds: float, steer_voltage: float) -> Array:
        """Return the cylinder pressure [Pa] after each tick at a constant steering valve voltage [V]."""
        found = []
        for _ in range(round(seconds / TICK_S)):
            self.go_by_voltage(TICK_S, steer_voltage)
            found.append(self.plant.actuation()[1])
        return np.array(found)

    def _drive(self, seconds: float, voltage: Callable[[Truth], float]) -> Trace:
        truths, wheels = [], []
        for _ in range(round(seconds / TICK_S)):
            drive = Drive(voltage(self.truth), self.pedal_voltage())
            truth = self.plant.advance(drive)
            self.truth = truth._replace(steer_samples=truth.steer_samples.copy())
            truths.append(self.truth)
            wheels.append(self.plant.wheels().copy())
        return Trace(truths, wheels)

    def steer_voltage(self, angle: float) -> float:
        """Return the steering valve voltage [V] of a proportional controller with dead-band compensation; `angle` is
        the setpoint of the steering angle [rad]."""
        error = angle - self.truth.steer
        if abs(error) < STEER_TOLERANCE:
            return NEUTRAL_V
        return NEUTRAL_V + 20.0 * error + copysign(0.4, error)

    def pedal_voltage(self) -> float:
        """Return the pedal valve voltage [V] of a cascade: PI control of the speed by the pedal position, and
        proportional control of the pedal position with dead-band compensation.

        The proportional part of the PI controller uses the wheel speed, which does not contain the longitudinal
        oscillation of the tractor on its tyres. The integral part uses the tractor speed.
        """
        wanted = self.speed / self.full_speed + 0.1 * (self.speed - self.truth.wheel_speed) + self.integral
        self.integral += 0.1 * (self.speed - self.truth.speed) * TICK_S
        push = 10.0 * (wanted - self.truth.pedal)
        return NEUTRAL_V + push + copysign(0.3, push)


def hold(plant: Any, seconds: float, drive: Drive = REST) -> Iterator[Truth]:
    """Yield the true state after each tick at constant valve voltages. Default: both valves in neutral."""
    for _ in range(round(seconds / TICK_S)):
        yield plant.advance(drive)


def acceleration(plant: Any, drive: Drive, begin: float, end: float, grade: float = 0.0) -> float:
    """Return the mean acceleration [m/s2] from speed `begin` to `end` [m/s] at constant valve voltages.

    The simulation ends at the speed `end` or after 30 s. `grade` is the slope in the driving direction [rad].
    """
    t, v, sign = [], [], copysign(1.0, end - begin)
    for truth in hold(plant, 30.0, drive):
        speed = truth.speed / cos(grade)
        if sign * (speed - end) > 0.0:
            break
        if sign * (speed - begin) > 0.0:
            t.append(truth.t)
            v.append(speed)
    return float(np.polyfit(t, v, 1)[0])


def track_course() -> Callable[[Truth], float]:
    """Return a controller that keeps the antenna's course due east: a function from true state to steering angle
    [rad]."""
    total, gain, per_second = 0.0, 1.5, 0.5

    def rule(truth: Truth) -> float:
        nonlocal total
        vx, vy = truth.antenna_velocity[:2]
        course = float(np.arctan2(vy, max(vx, 0.1)))
        total += per_second * course * TICK_S
        return -gain * course - total

    return rule


def mujoco_plant(
    tyre: Any,
    terrain: Terrain | Ground = LEVEL,
    machine: Machine = STOCK,
    settle_s: float = 3.0,
    dt: float = 0.002,
    start: Reference = ORIGIN,
    tick_s: float = TICK_S,
) -> tuple[MujocoPlant, Truth]:
    """Return a MuJoCo plant with the tyre model `tyre`, settled at `start`, and its true state."""
    ground = terrain if isinstance(terrain, Ground) else terrain.ground()
    plant = MujocoPlant(Mujoco(tyre=tyre, settle_s=settle_s), machine, ground, Clock.of(dt, tick_s))
    return plant, plant.reset(start)
