"""Linear bicycle model of [Kayacan2015], for level ground only.

The lateral velocity v and yaw rate gamma follow the equation `sondenklem`, the pose follows the equation
`kinematicmodeltractor2` (docs/equations.md). The slip angle of a tyre is its lateral velocity divided by the rolling
speed |u|. The model is therefore also valid in reverse, where an understeering tractor oversteers.

Speed and steering angle are constant during a physics step. The solution for v and gamma is then exact (closed-form
exponential of the 2 x 2 matrix); the position is integrated with Simpson's rule. Below the speed `CRAWL`, v and gamma
have their steady-state values, because the time constants of the lateral dynamics approach zero. The models of valves
and driveline are the same as in the MuJoCo plant, with a rigid cylinder and no wheel slip. The wheels steer only after
the cylinder has crossed the backlash.
"""

from collections.abc import Iterator
from math import atan2, cos, cosh, exp, inf, isfinite, nan, radians, sin, sinh, sqrt, tan
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.core.geometry import from_heading, wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit, kernel
from agrobot_mj.core.signals import NOMINAL, Array, Conditions, Matrix, Reference, Truth
from agrobot_mj.core.spec import Positive, Spec
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import DriveLaw, DriveMemory, drive_law, drive_step, reset_drive
from agrobot_mj.machine.hydraulics import (
    ValveLaw,
    ValveMemory,
    reset_valve,
    static_flow,
    valve_law,
    valve_step,
    worn_valve,
)
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.base import Clock, Motion, RunningPlant, TractorMotion, copies, write
from agrobot_mj.plants.mujoco.drawing import DrawnTractor, Ghost, poses_of, show
from agrobot_mj.terrain import Ground
from agrobot_mj.terrain.memory import AnyArray
from agrobot_mj.tyres.linear import unlike_a_tyre

CLOCK = Clock()
CRAWL = 0.05  # Speed below which lateral velocity and yaw rate have their steady-state values [m/s]


class Bicycle(Spec):
    """Linear single-track model with one cornering stiffness per axle."""

    sized: ClassVar = {
        "front_cornering_stiffness_n_rad": {"front_load": 1},
        "rear_cornering_stiffness_n_rad": {"rear_load": 1},
    }

    kind: Literal["bicycle"] = "bicycle"
    front_cornering_stiffness_n_rad: Positive = 14_800.0
    """Cornering stiffness C_alpha,f of the front axle [N/rad]. Assumed value (range 10e3-19e3 for a cone index of
    450-1800 kPa), computed for two tyres at 1200 kPa [GeeCloughSommer1981]."""
    rear_cornering_stiffness_n_rad: Positive = 30_000.0
    """Cornering stiffness C_alpha,r of the rear axle [N/rad]. Assumed value (range 18e3-40e3) [GeeCloughSommer1981]."""

    def fast_step_s(self, tractor: TractorParameters) -> float:
        """Return the duration of a physics step [s] for the scenario setting `physics = "fast"`."""
        return 0.005

    def hints(self, machine: Machine, speed: float) -> Iterator[str]:
        """Yield a message for each cornering stiffness that is implausible for the static load of its axle."""
        loads = machine.tractor.front_axle_load, machine.tractor.rear_axle_load
        given = self.front_cornering_stiffness_n_rad, self.rear_cornering_stiffness_n_rad
        for axle, load, C_alpha in zip(("front", "rear"), loads, given, strict=True):
            if line := unlike_a_tyre(f"plant.{axle}_cornering_stiffness_n_rad", C_alpha, load):
                yield line


class BicycleLaw(NamedTuple):
    """Parameters of the bicycle model for the compiled kernels, in SI units and with the symbols of [Kayacan2015].

    `play` is half the backlash of the steering linkage [rad], and `track_ratio` is half the track divided by the
    wheelbase. `antenna` is the position of the antenna ahead of, to the left of and above the rear-axle point.
    """

    m: float
    I_z: float
    l_f: float
    l_r: float
    C_f: float
    C_r: float
    steer_limit: float
    displacement: float
    play: float = 0.0
    cg_height: float = 0.0
    track_ratio: float = 0.0
    antenna: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rear_radius: float = 1.0


class Linear2(NamedTuple):
    """Elements of the matrices A and B of the lateral dynamics d(v, gamma)/dt = A (v, gamma) + B delta.

    The variables are the lateral velocity v, the yaw rate gamma and the steering angle delta.
    """

    A11: float
    A12: float
    A21: float
    A22: float
    B1: float
    B2: float


@kernel
def lateral_dynamics(p: BicycleLaw, u: float) -> Linear2:
    """Return the matrices A and B of the lateral dynamics at a nonzero speed `u` [m/s], negative in reverse."""
    # slip angles use the rolling speed |u|; the term of the steering angle, -u delta / |u|, changes sign in reverse
    rolling, ahead = abs(u), 1.0 if u > 0.0 else -1.0
    coupling = -p.l_f * p.C_f + p.l_r * p.C_r
    return Linear2(  # [agrobots: sondenklem]
        A11=-(p.C_f + p.C_r) / (p.m * rolling),
        A12=coupling / (p.m * rolling) - u,
        A21=coupling / (p.I_z * rolling),
        A22=-(p.l_f**2 * p.C_f + p.l_r**2 * p.C_r) / (p.I_z * rolling),
        B1=ahead * (p.C_f / p.m),
        B2=ahead * (p.l_f * p.C_f / p.I_z),
    )


@kernel
def steady_state(a: Linear2, delta: float) -> tuple[float, float]:
    """Return the steady-state lateral velocity [m/s] and yaw rate [rad/s] at a steering angle `delta` [rad]."""
    det = a.A11 * a.A22 - a.A12 * a.A21
    v = (-a.A22 * a.B1 + a.A12 * a.B2) / det * delta
    gamma = (a.A21 * a.B1 - a.A11 * a.B2) / det * delta
    return v, gamma


@kernel
def propagate(a: Linear2, v: float, gamma: float, delta: float, t: float) -> tuple[float, float, float]:
    """Return lateral velocity [m/s], yaw rate [rad/s] and yaw change [rad] after `t` [s] at a constant angle
    `delta`."""
    # relative to the steady state x_s the system is homogeneous: x(t) = x_s + exp(A t) (x(0) - x_s)
    v_s, gamma_s = steady_state(a, delta)
    # with s the mean of A's eigenvalues and s +- w both of them, (A - s)^2 = w^2, so that the series of the
    # exponential sums to exp(A t) = exp(s t) (cosh(w t) + sinh(w t) / w (A - s))
    s, det = 0.5 * (a.A11 + a.A22), a.A11 * a.A22 - a.A12 * a.A21
    w2 = s * s - det
    if w2 > 1e-12:
        w = sqrt(w2)
        c, sc = cosh(w * t), sinh(w * t) / w
    elif w2 < -1e-12:  # a complex pair: cosh and sinh of i w t
        w = sqrt(-w2)
        c, sc = cos(w * t), sin(w * t) / w
    else:  # a double eigenvalue: the limit of both cases
        c, sc = 1.0, t
    e, dv, dg = exp(s * t), v - v_s, gamma - gamma_s
    v_t = e * (c * dv + sc * ((a.A11 - s) * dv + a.A12 * dg))
    g_t = e * (c * dg + sc * (a.A21 * dv + (a.A22 - s) * dg))
    # integral of the decaying part of gamma: second row of A^-1 (x(t) - x(0)); the steady part adds gamma_s t
    turned = (a.A11 * (g_t - dg) - a.A21 * (v_t - dv)) / det + gamma_s * t
    return v_t + v_s, g_t + gamma_s, turned


@kernel
def step(p: BicycleLaw, state: Array, u: float, delta: float, dt: float) -> None:
    """Advance `state` (x, y, yaw, lateral velocity, yaw rate) in place by `dt` [s], at the speed `u` [m/s] and the
    steering angle `delta` [rad]."""
    yaw, v, gamma = state[2], state[3], state[4]
    if abs(u) < CRAWL:
        a = lateral_dynamics(p, CRAWL)
        fraction = u / CRAWL
        v_s, gamma_s = steady_state(a, delta)
        v_1, gamma_1 = fraction * v_s, fraction * gamma_s
        v_m, turned_m, turned = v_1, 0.5 * gamma_1 * dt, gamma_1 * dt
        v = v_1
    else:
        a = lateral_dynamics(p, u)
        v_m, _, turned_m = propagate(a, v, gamma, delta, 0.5 * dt)
        v_1, gamma_1, turned = propagate(a, v, gamma, delta, dt)
    dx0, dy0 = planar_velocity(yaw, u, v)
    dxm, dym = planar_velocity(yaw + turned_m, u, v_m)
    dx1, dy1 = planar_velocity(yaw + turned, u, v_1)
    # Simpson's rule: start, middle and end of the step
    state[0] += dt / 6 * (dx0 + 4 * dxm + dx1)
    state[1] += dt / 6 * (dy0 + 4 * dym + dy1)
    state[2], state[3], state[4] = yaw + turned, v_1, gamma_1


@kernel
def planar_velocity(psi: float, u: float, v: float) -> tuple[float, float]:
    """Return the east and north velocity of the CG [m/s] for heading `psi`, forward speed `u` and lateral speed `v`."""
    return u * cos(psi) - v * sin(psi), u * sin(psi) + v * cos(psi)  # [agrobots: kinematicmodeltractor2]


class BicycleRig(NamedTuple):
    """Parameters and state of a bicycle model for the compiled loop; the arrays are modified in place.

    `state` = (x, y, yaw, v, gamma, delta, distance travelled, steering angle at the cylinder).
    """

    law: BicycleLaw
    state: Array
    valve: ValveLaw
    valve_memory: ValveMemory
    drive: DriveLaw
    drive_memory: DriveMemory
    samples: Matrix  # Steering angle, pedal, and angles of both front wheels after each step, shape (4, n)
    shown: DrawnTractor


@kernel
def run_steps(rig: Held[BicycleRig], voltages: tuple[float, float], first: int, clear: bool) -> tuple[bool, bool]:
    """Advance the bicycle by the physics steps of a tick, starting with step `first`, and move the drawn tractor.

    The results are True, unless MuJoCo has reported an error, and `clear`.
    """
    p, state, valve, valve_memory, drive, drive_memory, samples, shown = fetched(rig)
    for i in range(first, samples.shape[1]):
        flow = valve_step(valve, valve_memory, voltages[0])
        stop = p.steer_limit + p.play
        state[7] = min(max(state[7] + flow / p.displacement * drive.dt, -stop), stop)
        state[5] = min(max(state[5], state[7] - p.play), state[7] + p.play)
        u = drive_step(drive, drive_memory, voltages[1])
        step(p, state, u, state[5], drive.dt)
        state[6] += u * drive.dt
        samples[0, i], samples[1, i], side = state[5], drive_memory.pedal[0], p.track_ratio * tan(state[5])
        # Ackermann geometry: the axes of all wheels meet at the turning centre
        samples[2, i], samples[3, i] = atan2(tan(state[5]), 1 - side), atan2(tan(state[5]), 1 + side)
    return show(shown, state[0], state[1], state[2], state[5], state[6]) == 0, clear


@jit
def look(rig: Held[BicycleRig], t: float) -> tuple[Held[Truth], TractorMotion]:
    """Return the true state at time `t` [s], and the motion of the tractor. The model has no roll, pitch and wheel
    slip."""
    p, state, valve, valve_memory, _, drive_memory, samples, _ = fetched(rig)
    x, y, psi, v, gamma, delta = state[0], state[1], state[2], state[3], state[4], state[5]
    u, pedal, yaw, rates = drive_memory.speed[0], drive_memory.pedal[0], wrap(state[2]), (0.0, 0.0, state[4])
    dx, dy = from_heading(psi, -p.l_r, 0.0)
    vx, vy = from_heading(psi, u, v - p.l_r * gamma)
    arm_x, arm_y = from_heading(psi, p.antenna[0], p.antenna[1])
    cg = Motion((x, y, p.cg_height), (*planar_velocity(psi, u, v), 0.0))
    rear = Motion((x + dx, y + dy, 0.0), (vx, vy, 0.0))
    antenna = Motion((x + dx + arm_x, y + dy + arm_y, p.antenna[2]), (vx - gamma * arm_y, vy + gamma * arm_x, 0.0))
    fastest = max(abs(cg.velocity[0]), abs(cg.velocity[1])) if isfinite(state.sum()) else inf
    flow = static_flow(valve, valve_memory.spool[0])
    steer, pedals, knuckles, unknown = samples[0].copy(), samples[1].copy(), samples[2:].copy(), (nan, nan)
    return held(Truth(
        t, x, y, p.cg_height, yaw, 0.0, 0.0, u, v, gamma, delta, pedal, rear.place[0], rear.place[1], antenna.place,
        antenna.velocity, steer, pedals, u, rates, knuckles, rear.velocity, unknown,
    )), TractorMotion(
        cg, antenna, rear, (yaw, 0.0, 0.0), u, v, gamma, rates, delta, pedal, u / p.rear_radius, (flow, nan, nan),
        fastest, 1.0, False,
    )  # fmt: skip


class BicycleState(NamedTuple):
    """Saved state of a `BicyclePlant`."""

    arrays: tuple[AnyArray, ...]  # Copies of the motion state, the samples, and the states of valve and driveline
    conditions: Conditions  # Conditions of the last tick, of which wear changes the valve
    ticks: int


class BicyclePlant(RunningPlant):
    """Bicycle model in a run, with the states of vehicle motion, steering valve and driveline."""

    def __init__(self, spec: Bicycle, machine: Machine, ground: Ground, clock: Clock = CLOCK) -> None:
        tractor = machine.tractor
        law = BicycleLaw(
            m=tractor.mass_kg,
            I_z=tractor.yaw_inertia_kg_m2,
            l_f=tractor.cg_to_front_axle,
            l_r=tractor.cg_to_rear_axle,
            C_f=spec.front_cornering_stiffness_n_rad,
            C_r=spec.rear_cornering_stiffness_n_rad,
            steer_limit=tractor.steer_limit,
            displacement=machine.cylinder.displacement,
            play=radians(machine.linkage.backlash_deg) / 2,
            cg_height=tractor.cg_height_m,
            track_ratio=tractor.track_m / (2 * tractor.wheelbase_m),
            antenna=tractor.antenna,
            rear_radius=tractor.rear_wheel_radius_m,
        )
        self.tractor, self.ground, self.ghost = tractor, ground, Ghost(tractor)
        self.conditions, self.braking = NOMINAL, 0.0
        self.scene, self.clear, self.ticks, self.tick_s = self.ghost.scene, False, 0, clock.tick_s
        self.nominal_valve, self.valve_memory = valve_law(machine.valve, clock.dt)
        drive, self.drive_memory = drive_law(machine.driveline, clock.dt)
        self.state, self.samples = np.zeros(8), np.zeros((4, clock.steps))
        moved = self.state, self.nominal_valve, self.valve_memory, drive, self.drive_memory
        self.parts = BicycleRig(law, *moved, self.samples, self.ghost.shown)
        self.rig = held(self.parts, as_it_is=True)
        self._compile((np.zeros((0, 6)), *poses_of(self.ghost.data)), run_steps, look)
        self._look()

    def reset(self, start: Reference, conditions: Conditions = NOMINAL) -> Truth:
        """Place the tractor at rest with its CG at the start of the path; return the true state."""
        self._apply_conditions(conditions)
        self.state[:] = 0.0
        self.samples[:] = 0.0
        reset_valve(self.valve_memory)
        reset_drive(self.drive_memory)
        self.state[:3] = start.x, start.y, start.yaw
        self.ticks = 0
        self._update_bodies()
        return self.truth()

    def _apply_conditions(self, conditions: Conditions) -> None:
        """Set the conditions of the next tick. Of the faults, only wear of the steering valve has an effect."""
        before, self.conditions = self.conditions, conditions
        wear = conditions.valve_gain, conditions.valve_dead_band
        if wear != (before.valve_gain, before.valve_dead_band):
            self.rig = held(self.parts._replace(valve=worn_valve(self.nominal_valve, *wear)), as_it_is=True)

    @property
    def _arrays(self) -> tuple[AnyArray, ...]:
        return self.state, self.samples, *self.valve_memory, *self.drive_memory

    def save(self) -> BicycleState:
        """Return a copy of the complete state of the plant, for the method `restore`."""
        return BicycleState(copies(self._arrays), self.conditions, self.ticks)

    def restore(self, state: BicycleState) -> None:
        """Restore a state that `save` has returned."""
        write(self._arrays, state.arrays)
        self._apply_conditions(state.conditions)
        self.ticks = state.ticks
        self._update_bodies()
        self._look()

    def configuration(self) -> Array:
        """Return the generalised positions (`qpos`) of the MuJoCo tractor that images show, shape (nq,)."""
        return np.array(self.ghost.data.qpos)
