"""Steering with mechanics: kingpins, cylinder and load

The steering system has a cylinder, a valve section, and kingpins with offset, inclination and friction, all sized for
the class of the tractor. The wheels are steered at 10 deg/s through the straight-ahead position, both parked and
rolling at 1 m/s. The theoretical torque of the parked tractor is mu W sqrt(b^2 / 8 + e^2), with the friction mu, front
axle load W, tyre width b and kingpin offset e. This rule of a manufacturer of steering units [Eaton2006] assumes
blocked wheels. Here the wheels roll about their kingpins, so that e adds only rolling resistance. If the relief
pressure is too low to steer the parked tractor, the steering stalls at rest and works while the tractor rolls. Without
scrubbing, the mean of the torques in both directions lifts the weight on inclined kingpins: W h sin(2 s) sin(delta) /
2. Here s is the inclination, r the loaded radius, and h = e + r tan(s) the distance from the kingpin to the wheel at
its centre. In a steady bend, the caster angle c adds the torque (F_y + W phi) r sin(c). This torque is due to the side
force F_y and to the lateral component of the weight on an axle with roll phi. Tilting wheels lower the weight, which
reduces the torque by W r sin(c)^2 sin(2 delta) / 2.
"""

from collections.abc import Iterator
from math import degrees, radians, sin, sqrt, tan
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.signals import NEUTRAL_V
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial
from agrobot_mj.machine import Cylinder, Linkage, Machine, Valve
from agrobot_mj.machine.linkage import DRY_GRIP
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.driver import ORIGIN, Driver
from agrobot_mj.tyres import Linear, MagicFormula
from agrobot_mj.tyres.patch import FORCE_Y, LOAD

CYLINDER = Cylinder(bore_mm=25.0, rod_mm=14.0, arm_m=0.08, stiffness_n_m_rad=2.8e4, damping_n_m_s_rad=60.0)
VALVE = Valve(gain_left_l_min_v=0.24, gain_right_l_min_v=0.21, section_flow_l_min=0.9)
LINKAGE = Linkage(kingpin_offset_m=0.03, kingpin_inclination_deg=8.0, caster_deg=3.0, friction_n_m=8.0)
SIZED = Machine(valve=VALVE, cylinder=CYLINDER, linkage=LINKAGE)
"""Steering system sized for the class of the tractor, as in the scenario `steering_backlash`."""
RATE_DEG_S, ENDS_DEG, WITHIN_DEG = 10.0, 15.0, 8.0
"""Rate [deg/s] and end angle [deg] of steering sweeps, and half width of the range for averaging torques [deg]."""
SPEED_M_S = 1.0
CASTER_DEG = 6.0
WEAK_BAR = 25.0  # Relief pressure that is too low for steering at standstill [bar]


class Turning(NamedTuple):
    """Mean steering torques of sweeps in both directions."""

    torque: float  # Torque that opposes the motion [N m], mean of both directions
    offset: float  # Mean of the signed torques of both directions [N m], positive to the left


def volts(machine: Machine, side: int) -> float:
    """Return the valve voltage for the steering rate `RATE_DEG_S` to one side (1 left, -1 right) [V]."""
    gain = machine.valve.gain_left_l_min_v if side > 0 else machine.valve.gain_right_l_min_v
    flow = radians(RATE_DEG_S) * machine.cylinder.displacement * 6e4
    return NEUTRAL_V + side * (machine.valve.dead_band_v + flow / gain)


def driver_of(plant: MujocoPlant, speed: float) -> Driver:
    """Return the `Driver` of a tractor that is at rest or rolls straight ahead at `speed` [m/s]."""
    driver = Driver(plant, plant.reset(ORIGIN), speed)
    if speed:
        driver.go(3.0)
    return driver


def sweep(driver: Driver, machine: Machine, middle_deg: float = 0.0) -> Turning:
    """Steer to the left, to the right, and to the left again. Return the mean torques of the last two sweeps at
    steering angles within `WITHIN_DEG` of `middle_deg` [deg]."""
    torques: dict[int, list[float]] = {1: [], -1: []}
    for turn, side in enumerate((1, -1, 1)):
        for _ in range(200):
            angle = degrees(driver.go_by_voltage(0.05, volts(machine, side)).truths[-1].steer) - middle_deg
            pressure = driver.plant.actuation()[1]
            if turn and abs(angle) < WITHIN_DEG:
                torques[side].append(pressure * machine.cylinder.displacement)
            if side * angle > ENDS_DEG:
                break
    left, right = (float(np.mean(torques[side])) for side in (1, -1))
    return Turning((left - right) / 2, (left + right) / 2)


def scrubbing(front_load: float, width: float, offset: float) -> float:
    """Return the steering torque of both parked front wheels [N m], by the equation of steering manufacturers
    [Eaton2006]."""
    return DRY_GRIP * front_load * sqrt(width**2 / 8 + offset**2)


def with_linkage(**linkage: float) -> Machine:
    """Return a copy of the machine `SIZED` with changed linkage parameters."""
    return SIZED._replace(linkage=LINKAGE.model_copy(update=linkage))


def loaded_radius(plant: MujocoPlant) -> float:
    """Return the height of the front wheel centre above the ground at static load [m]."""
    tractor = plant.tractor
    return tractor.front_wheel_radius_m - tractor.front_axle_load / 2 / tractor.front_wheel.stiffness


def parking_checks(m: Trial, tyre: Any) -> Iterator[Check]:
    """Yield checks of steering torque and pressure of a parked and a rolling tractor, for two kingpin offsets."""
    for offset in (0.0, LINKAGE.kingpin_offset_m):
        machine = with_linkage(kingpin_offset_m=offset)
        plant, _ = m.mujoco(tyre, machine=machine)
        tractor, where = plant.tractor, f"kingpin offset {1e3 * offset:g} mm"
        wanted = scrubbing(tractor.front_axle_load, tractor.front_wheel_width_m, offset)
        still = sweep(driver_of(plant, 0.0), machine).torque
        bar = still / machine.cylinder.displacement / 1e5
        yield m.about(f"parked torque, {where}", tyre.kind, "N m").near(still, wanted, 0.15)
        yield m.about(f"minimum parked pressure, {where}", tyre.kind, "bar").above(bar, 30.0)
        yield m.about(f"maximum parked pressure, {where}", tyre.kind, "bar").below(bar, 70.0)
        rolled = sweep(driver_of(plant, SPEED_M_S), machine).torque
        yield m.about(f"torque at 1 m/s divided by parked torque, {where}", tyre.kind).below(rolled / still, 0.35)


def relief_checks(m: Trial, tyre: Any) -> Iterator[Check]:
    """Yield checks of the steering rate of a parked and of a rolling tractor at a low relief pressure."""
    machine = SIZED._replace(cylinder=CYLINDER.model_copy(update={"relief_pressure_bar": WEAK_BAR}))
    plant, _ = m.mujoco(tyre, machine=machine)
    rates = []
    for speed in (0.0, SPEED_M_S):
        driver = driver_of(plant, speed)
        driver.go_by_voltage(1.0, volts(machine, 1))
        seen = driver.go_by_voltage(0.5, volts(machine, 1))["steer"]
        rates.append(degrees(seen[-1] - seen[0]) / (0.05 * (len(seen) - 1)))
    weak = "steering rate under weak relief"
    yield m.about(f"{weak}, parked", tyre.kind, "deg/s").below(abs(rates[0]), 0.2)
    yield m.about(f"{weak}, rolling", tyre.kind, "deg/s").above(rates[1], 5.0)


def lift_check(m: Trial) -> Check:
    """Return a check of the steering torque that lifts the tractor at 20 degrees of steering, without scrubbing."""
    tyre, angle = MagicFormula(patch_half_length_m=0.0, trail_m=0.0), 20.0
    machine = with_linkage(caster_deg=0.0, kingpin_offset_m=0.06, friction_n_m=0.0)
    plant, _ = m.mujoco(tyre, machine=machine)
    lift = sweep(driver_of(plant, 0.0), machine, angle).offset
    s = radians(machine.linkage.kingpin_inclination_deg)
    hub = machine.linkage.kingpin_offset_m + loaded_radius(plant) * tan(s)
    wanted = plant.tractor.front_axle_load * hub * sin(2 * s) / 2 * sin(radians(angle))
    return m.about("torque of the lifted weight at 20 deg", tyre.kind, "N m").near(lift, wanted, 0.15)


def trailing(m: Trial, tyre: Any) -> Check:
    """Return a check of the steering torque due to caster in a steady bend, at 10 degrees of steering and 3 m/s."""
    torques = []
    for caster in (0.0, CASTER_DEG):
        machine = with_linkage(kingpin_offset_m=0.0, kingpin_inclination_deg=0.0, friction_n_m=0.0, caster_deg=caster)
        plant, _ = m.mujoco(tyre, machine=machine)
        driver = driver_of(plant, 3.0)
        for _ in range(200):
            if degrees(driver.go_by_voltage(0.05, volts(machine, 1)).truths[-1].steer) > 10.0:
                break
        driver.go_by_voltage(4.0, NEUTRAL_V)
        torques.append(plant.actuation()[1] * machine.cylinder.displacement)
    report, tractor, delta = plant.tyred.report, plant.tractor, plant.truth().steer
    roll = float(report[1, LOAD] - report[0, LOAD]) / (tractor.front_wheel.stiffness * tractor.track_m)
    side, weight, radius = float(report[:2, FORCE_Y].sum()), tractor.front_axle_load, loaded_radius(plant)
    c = radians(CASTER_DEG)
    wanted = (side + weight * roll) * radius * sin(c) - weight * radius * sin(c) ** 2 * sin(2 * delta) / 2
    about = m.about(f"torque of caster at {degrees(delta):.0f} deg of steering", tyre.kind, "N m")
    return about.near(torques[1] - torques[0], wanted, 0.1)


def run(m: Trial) -> Iterator[Check]:
    """Yield the check of the caster with `linear`, and all other checks with `magic_formula`. Quick mode checks only
    the steering at stall and the torque that lifts the tractor."""
    if m.quick:
        yield lift_check(m)
    else:
        yield from parking_checks(m, MagicFormula())
    yield from relief_checks(m, MagicFormula())
    if not m.quick:
        yield lift_check(m)
        yield trailing(m, Linear())
