"""Physics of one tick: compiled loop over MuJoCo steps with valves, `mj_step1`, loads, tyres and `mj_step2`."""

from math import atan2, cos, hypot, inf, isfinite, isnan, nan, radians, sin
from typing import NamedTuple

import mujoco

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit, kernel
from agrobot_mj.core.signals import Array, Index, Truth
from agrobot_mj.core.vectors import Vector, cross, plus, to_world
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import DriveLaw, DriveMemory, drive_step
from agrobot_mj.machine.hydraulics import ValveLaw, ValveMemory, beyond_play, loaded_flow, static_flow, valve_step
from agrobot_mj.plants.base import Motion, Report, TractorMotion
from agrobot_mj.plants.mujoco.c_api import (
    actuate,
    integrate,
    joint_forces,
    kinematics,
    motions,
    step1,
    step1_again,
    step2,
)
from agrobot_mj.plants.mujoco.clearance import Clearance, is_clear
from agrobot_mj.plants.mujoco.coupling import accelerate, is_alone, is_within_stops, set_coupled
from agrobot_mj.plants.mujoco.loads import PULL, SIDE, apply_loads
from agrobot_mj.plants.mujoco.tools import Attached, apply_tools, carry_point, implement_report
from agrobot_mj.plants.mujoco.views import CHASSIS, Views
from agrobot_mj.terrain.grid import Ground
from agrobot_mj.terrain.memory import AnyArray
from agrobot_mj.tyres.laws import wheel_step
from agrobot_mj.tyres.patch import TyreSet, WheelMotion

CONTACTLESS = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
STEERING, DRIVE = 0, 1  # Indices of the actuators, in the order of `models/tractor.xml`


class Oil(NamedTuple):
    """Parameters of the oil in the steering cylinder and hydrostat: conversion of flow to motion, and relief limits."""

    displacement: float  # Displacement of the steering cylinder [m3/rad]
    steer_limit: float  # Maximum steering angle in both directions, given by the stops [rad]
    steer_windup: float  # Deflection of the steering at relief pressure: relief torque divided by stiffness [rad]
    steer_lead: float  # Damping of the steering divided by its stiffness [s]
    steer_play: float  # Half the backlash between cylinder and wheels [rad], or 0 if there is no backlash
    drive_radius: float  # Rim speed divided by angular velocity of the wheels [m]
    drive_torque: float  # Relief torque of the hydrostat [N m]
    drive_power: float  # Maximum driving power [W]
    drive_stiffness: float  # Stiffness of the trapped oil in the drive [N m/rad]
    drive_lead: float  # Damping of the drive divided by its stiffness [s]
    droop: float  # Relative decrease of the drive's speed at its power limit [-]
    front_share: float
    """Fraction of the motor torque at the front wheels [-], or 0 without front motors."""
    front_gear: float  # Radius of the front wheels divided by radius of the rear wheels [-]


def oil_of(machine: Machine) -> Oil:
    """Return the oil parameters of a machine's steering cylinder and hydrostat."""
    column, drive = (
        machine.cylinder.column(machine.tractor, machine.linkage),
        machine.driveline.strength(machine.tractor),
    )
    return Oil(
        displacement=machine.cylinder.displacement,
        steer_limit=machine.tractor.steer_limit,
        steer_windup=column.relief_torque / column.stiffness,
        steer_lead=column.damping / column.stiffness,
        steer_play=radians(machine.linkage.backlash_deg) / 2,
        drive_radius=machine.tractor.rear_wheel_radius_m,
        drive_torque=drive.torque,
        drive_power=drive.power,
        drive_stiffness=drive.stiffness,
        drive_lead=drive.damping / drive.stiffness,
        droop=machine.driveline.engine_droop,
        front_share=machine.driveline.motor_front_share or 0.0,
        front_gear=machine.tractor.front_wheel_radius_m / machine.tractor.rear_wheel_radius_m,
    )


class Actuators(NamedTuple):
    """Models of the steering valve, the drive and the trapped oil. The physics steps modify the state arrays."""

    oil: Oil
    valve: ValveLaw
    valve_memory: ValveMemory
    drive: DriveLaw
    drive_memory: DriveMemory
    cylinder: Array  # Cylinder position as an angle of the virtual wheel, used only with backlash, shape (1,) [rad]


class Tyred(NamedTuple):
    """Tyres of a tractor with their state. The physics steps modify the arrays."""

    native: bool  # Whether MuJoCo contact carries the wheels
    tyres: TyreSet
    ground: Ground
    bristles: Array
    """Deflections of tyres, shape (4, 4): bristle longitudinal, lateral [m], twist [rad], carcass lateral [m]."""
    report: Array  # Report of the tyres, shape (4, 6); see `tyres.patch`


class Assembly(NamedTuple):
    """Model, data and components of a simulated tractor for the compiled loop, which modifies the arrays."""

    views: Views
    tyred: Tyred
    attached: Attached
    loads: Array
    actuators: Actuators
    samples: Array  # Angle of the virtual wheel, pedal, and angles of both knuckles after each step, shape (4, n)
    clearance: Clearance
    cg_site: Array  # Position of the CG in the chassis frame [m], shape (3,)
    antenna_site: Array  # Position of the antenna in the chassis frame [m], shape (3,)
    flags: AnyArray  # Field `opt.disableflags` of the model, shape (1,)


@kernel
def apply_tyres(v: Views, wheels: Index, tyred: Tyred, dt: float, last: bool) -> None:
    """Advance the tyre of each wheel body in `wheels` by one step, and write the tyre wrench to `xfrc_applied`.

    Except for the load, the log quantities in `tyred.report` are computed only in the `last` step of a tick.
    """
    c = v.root_com
    for i in range(wheels.size):
        b = wheels[i]
        centre = (v.xpos[b, 0], v.xpos[b, 1], v.xpos[b, 2])
        axle = (v.xmat[b, 1], v.xmat[b, 4], v.xmat[b, 7])
        w = (v.cvel[b, 0], v.cvel[b, 1], v.cvel[b, 2])
        # cvel is the velocity of the body at the tractor's centre of mass: transfer it to the wheel
        d = (centre[0] - c[0], centre[1] - c[1], centre[2] - c[2])
        velocity = (
            v.cvel[b, 3] + w[1] * d[2] - w[2] * d[1],
            v.cvel[b, 4] + w[2] * d[0] - w[0] * d[2],
            v.cvel[b, 5] + w[0] * d[1] - w[1] * d[0],
        )
        motion = WheelMotion(centre, axle, velocity, w)
        wheel_step(tyred.tyres, i, tyred.ground, motion, dt, tyred.bristles[i], v.xfrc[b], tyred.report[i], last)


@kernel
def apply_implement(v: Views, a: Attached, ground: Ground, dt: float, last: bool) -> None:
    """Write the wrenches on the implement's body and wheels to `xfrc_applied`."""
    apply_tools(v, a, ground, dt)
    if not a.native:
        apply_tyres(v, a.wheels, Tyred(False, a.tyres, ground, a.bristles, a.wheel_report), dt, last)


@kernel
def take_up_play(v: Views, oil: Oil, cylinder: Array, dt: float) -> None:
    """Advance the cylinder of a steering linkage with play, and set the steering actuator.

    The cylinder angle integrates the flow. The deflection of the actuator spring is the angle between cylinder and
    wheel beyond the play.
    """
    angle = v.qpos[v.steer_q] + oil.steer_lead * v.qvel[v.steer_v]
    reach, stop = oil.steer_windup + oil.steer_play, oil.steer_limit + oil.steer_play
    cylinder[0] = min(max(cylinder[0], angle - reach, -stop), angle + reach, stop)
    v.act[STEERING] = angle + beyond_play(cylinder[0] - angle, oil.steer_play)
    cylinder[0] += v.ctrl[STEERING] * dt
    v.ctrl[STEERING] = 0.0


@kernel
def drive_motion(v: Views, oil: Oil) -> tuple[float, float]:
    """Return the angle [rad] and rate [rad/s] of the drive: torque-weighted means over the driven wheels."""
    wheel = 0.5 * (v.qpos[v.spins_q[0]] + v.qpos[v.spins_q[1]])
    speed = 0.5 * (v.qvel[v.spins_v[0]] + v.qvel[v.spins_v[1]])
    if oil.front_share > 0.0:
        ahead, rear = oil.front_share * oil.front_gear, 1.0 - oil.front_share
        wheel = rear * wheel + ahead * 0.5 * (v.qpos[v.fronts_q[0]] + v.qpos[v.fronts_q[1]])
        speed = rear * speed + ahead * 0.5 * (v.qvel[v.fronts_v[0]] + v.qvel[v.fronts_v[1]])
    return wheel, speed


@kernel
def droop_rate(v: Views, oil: Oil, rate: float) -> float:
    """Return the drive rate under load [rad/s]; engine droop decreases `rate` in proportion to the delivered power."""
    power = min(max(v.torques[DRIVE] * drive_motion(v, oil)[1] / oil.drive_power, 0.0), 1.0)
    return float(rate * (1.0 - oil.droop * power))


@kernel
def open_relief_valves(v: Views, oil: Oil) -> None:
    """Limit the deflection of the steering oil column by its relief pressure and the steering stops, and the deflection
    of the drive oil column by its relief pressure and the drive power."""
    angle = v.qpos[v.steer_q] + oil.steer_lead * v.qvel[v.steer_v]
    if oil.steer_play <= 0.0:
        low, high = angle - oil.steer_windup, angle + oil.steer_windup
        v.act[STEERING] = min(max(v.act[STEERING], low, -oil.steer_limit), high, oil.steer_limit)
    wheel, speed = drive_motion(v, oil)
    wheel += oil.drive_lead * speed
    powered = min(oil.drive_torque, oil.drive_power / max(abs(speed), 1e-3))
    ahead = (powered if speed >= 0.0 else oil.drive_torque) / oil.drive_stiffness
    behind = (powered if speed <= 0.0 else oil.drive_torque) / oil.drive_stiffness
    v.act[DRIVE] = min(max(v.act[DRIVE], wheel - behind), wheel + ahead)


@kernel
def start_step(v: Views, direct: bool, before: bool) -> int:
    """Run the first half of a physics step; return 1 after an error, else 0.

    In a `direct` step MuJoCo computes no constraints. `before` is whether the previous step was direct. Otherwise the
    coupling of the knuckles is disabled during the call.
    """
    if not direct:
        return int(step1(v.model, v.data))
    if before:
        return int(step1_again(v.model, v.data))
    set_coupled(v.coupling, False)
    failed = step1(v.model, v.data)
    set_coupled(v.coupling, True)
    return int(failed)


@kernel
def finish_step(v: Views, direct: bool) -> int:
    """Run the second half of a physics step; return 1 after an error, else 0.

    A `direct` step computes the accelerations by `accelerate` in closed form, other steps by MuJoCo's solver.
    """
    if not direct:
        return int(step2(v.model, v.data))
    if actuate(v.model, v.data) != 0:
        return 1
    accelerate(v)
    return int(integrate(v.model, v.data))


@kernel
def run_steps(rig: Held[Assembly], voltages: tuple[float, float], first: int, clear: bool) -> tuple[bool, bool]:
    """Advance the tractor by the physics steps of a tick, starting with step `first`.

    MuJoCo detects contacts unless `clear` is true, and after the first step in which the body could touch the ground.
    The results are whether MuJoCo has reported no error, and whether the body is clear of the ground. Each column of
    the sample array contains the values after one step.
    """
    v, tyred, attached, loads, actuators, samples, clearance, _, _, flags = fetched(rig)
    oil, valve, valve_memory, drive, drive_memory, cylinder = actuators
    loaded, alone, direct = loads[PULL] != 0.0 or loads[SIDE] != 0.0, clear and is_alone(v.coupling), False
    plain, done = flags[0], True
    if clear:
        flags[0] = plain | CONTACTLESS
    for i in range(first, samples.shape[1]):
        if clear and not is_clear(clearance, v.qpos):
            clear, alone, direct, flags[0] = False, False, False, plain
        last = i + 1 == samples.shape[1]
        flow = loaded_flow(valve, valve_step(valve, valve_memory, voltages[0]), v.torques[STEERING] / oil.displacement)
        v.ctrl[STEERING] = flow / oil.displacement
        v.ctrl[DRIVE] = drive_step(drive, drive_memory, voltages[1]) / oil.drive_radius
        if oil.droop > 0.0:
            v.ctrl[DRIVE] = droop_rate(v, oil, v.ctrl[DRIVE])
        if oil.steer_play > 0.0:
            take_up_play(v, oil, cylinder, drive.dt)
        open_relief_valves(v, oil)
        before, direct = direct, alone and is_within_stops(v.coupling, v.qpos)
        # positions and velocities are known afterwards, forces are not
        if start_step(v, direct, before) != 0:
            done = False
            break
        if loaded:
            apply_loads(v, loads, drive.dt)
        if not tyred.native:
            apply_tyres(v, v.wheels, tyred, drive.dt, last)
        if attached.body > 0:
            apply_implement(v, attached, tyred.ground, drive.dt, last)
        if finish_step(v, direct) != 0:
            done = False
            break
        samples[0, i] = v.qpos[v.steer_q]
        samples[1, i] = drive_memory.pedal[0]
        samples[2, i], samples[3, i] = v.qpos[v.knuckles_q[0]], v.qpos[v.knuckles_q[1]]
    flags[0] = plain
    # the last step has advanced qpos: update the bodies, so that truth and drawing are simultaneous
    done = done and kinematics(v.model, v.data) == 0
    if done and attached.body > 0 and first < samples.shape[1]:
        done = joint_forces(v.model, v.data) == 0
        for k in range(3):
            attached.pull[k] = v.cfrc_int[attached.body, 3 + k]
        done = done and motions(v.model, v.data) == 0
    return done, done and is_clear(clearance, v.qpos)


@kernel
def implement_values(rig: Held[Assembly]) -> Report:
    """Return the current values of the implement's log columns, in the order of `implement.COLUMNS`."""
    v, _, attached, _, _, _, _, _, _, _ = fetched(rig)
    return implement_report(v, attached)


@kernel
def motion_of(v: Views, omega: Vector, site: Array) -> Motion:
    """Return the motion of a chassis point `site` (3,), given in the chassis frame [m]."""
    q, w = v.qpos, v.qvel
    arm = to_world(v.xmat[CHASSIS], (site[0], site[1], site[2]))
    return Motion(plus((q[0], q[1], q[2]), arm), plus((w[0], w[1], w[2]), cross(omega, arm)))


@kernel
def observe(rig: Held[Assembly]) -> TractorMotion:
    """Return the motion of the tractor after the last physics step, with the state of actuators and implement."""
    v, _, attached, _, actuators, _, _, cg_site, antenna_site, _ = fetched(rig)
    R, q, w = v.xmat[CHASSIS], v.qpos, v.qvel
    omega = to_world(R, (w[3], w[4], w[5]))
    cg, antenna, yaw = motion_of(v, omega, cg_site), motion_of(v, omega, antenna_site), atan2(R[3], R[0])
    pressure = v.torques[STEERING] / actuators.oil.displacement
    flow = loaded_flow(actuators.valve, static_flow(actuators.valve, actuators.valve_memory.spool[0]), pressure)
    total, fastest, lean, folded = yaw + omega[2], 0.0, R[8], False
    if attached.body > 0:
        lean = min(lean, v.xmat[attached.body, 8])
        folded = attached.fold_q >= 0 and abs(q[attached.fold_q]) > attached.fold
    for k in range(3):
        total += cg.place[k] + antenna.place[k] + cg.velocity[k] + antenna.velocity[k]
        fastest = max(fastest, abs(cg.velocity[k]), abs(antenna.velocity[k]))
    return TractorMotion(
        cg=cg,
        antenna=antenna,
        rear=Motion((q[0], q[1], q[2]), (w[0], w[1], w[2])),
        attitude=(yaw, atan2(-R[6], hypot(R[7], R[8])), atan2(R[7], R[8])),
        speed=cos(yaw) * cg.velocity[0] + sin(yaw) * cg.velocity[1],
        lateral_speed=-sin(yaw) * cg.velocity[0] + cos(yaw) * cg.velocity[1],
        yaw_rate=omega[2],
        body_rates=(w[3], w[4], w[5]),
        steer=q[v.steer_q],
        pedal=actuators.drive_memory.pedal[0],
        spin=0.5 * (w[v.spins_v[0]] + w[v.spins_v[1]]),
        actuation=(flow, pressure, v.torques[DRIVE]),
        fastest=fastest if isfinite(total) else inf,
        lean_cosine=lean,
        folded=folded,
    )


@jit
def look(rig: Held[Assembly], t: float) -> tuple[Held[Truth], TractorMotion]:
    """Return the true state at time `t` [s], and the tractor motion."""
    m, (v, _, attached, _, actuators, samples, _, _, _, _) = observe(rig), fetched(rig)
    seen, working = m.antenna, (nan, nan)
    if attached.body > 0:
        place, _ = carry_point(v, attached.body, attached.point)
        working = place[0], place[1]
        if not isnan(attached.antenna[0]):
            above, velocity = carry_point(v, attached.body, attached.antenna)
            seen = Motion(above, velocity)
    (x, y, z), (rear_x, rear_y, _), (yaw, pitch, roll) = m.cg.place, m.rear.place, m.attitude
    steer, pedal, knuckles = samples[0].copy(), samples[1].copy(), samples[2:].copy()
    return held(Truth(
        t, x, y, z, wrap(yaw), pitch, roll, m.speed, m.lateral_speed, m.yaw_rate, m.steer, m.pedal, rear_x, rear_y,
        seen.place, seen.velocity, steer, pedal, actuators.oil.drive_radius * m.spin, m.body_rates, knuckles,
        m.rear.velocity, working,
    )), m  # fmt: skip
