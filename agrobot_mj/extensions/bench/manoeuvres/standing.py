"""Start, parking and braking of machines

Every machine of `agrobot-mj list --machines` is placed across slopes without its implement, on ground with sufficient
grip. The steepest slope on which the machine rests on four wheels must equal the tip-over angle in its data sheet. This
angle is the tilt of gravity at which a wheel of the machine lifts off level ground.

Parked with the brake applied and both valves in neutral, no tyre or machine may creep, on level ground or diagonally on
a slope. From 85 % to 20 % of its initial speed, with the hydrostat disconnected, the brake must decelerate the machine
by at least 3.55 m/s2 [EU2015]. The deceleration is reported without limits if only the rear wheels have brakes, because
their grip may be the limit.
"""

import io
from collections.abc import Iterator
from contextlib import redirect_stderr
from math import dist
from typing import Any

from agrobot_mj.core.resources import machine_files
from agrobot_mj.core.signals import NEUTRAL_V, Drive
from agrobot_mj.extensions.bench.manoeuvres import braking
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial
from agrobot_mj.extensions.bench.manoeuvres.tipping import GRIPPING, STEEPEST_DEG, tilt
from agrobot_mj.machine.driveline import BRAKING_M_S2
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.driver import hold
from agrobot_mj.scenario import Scenario, load_scenario
from agrobot_mj.scenario.reference import families
from agrobot_mj.terrain import Flat, Ground, Slope
from agrobot_mj.tyres.patch import LOAD

BRAKED = Drive(NEUTRAL_V, NEUTRAL_V, 1.0)
BAND_DEG, SOUGHT_DEG, HALVINGS = 0.3, 1.0, 5
"""Acceptance limit of the tipping slope [deg], half of its search range [deg], and number of bisection steps."""
STEADILY_DEG_S = 0.1  # Rate at which gravity is tilted [deg/s], so low that the tractor remains in equilibrium
PARKED_S, BRIEFLY_S, DRIFT_MM = 600.0, 30.0, 1.0
GRADES_DEG, DIAGONALLY_DEG = (0.0, 10.0), 60.0
"""Grades for the parking test [deg], and direction of steepest ascent for a machine that faces east [deg]."""
FASTEST_M_S, FROM, TO = 4.0, 0.85, 0.2
"""Initial speed of the braking test [m/s], at most 0.9 of top speed, and fractions of this speed between which the
deceleration is measured [-]."""
QUICK = ("compact", "orchard")


def bare(machine: str) -> Scenario:
    """Return the straight-line scenario of a machine without its implement."""
    return load_scenario("straight_line", {"machine": machine, "implement": {"kind": "none"}})


def plant_of(m: Trial, s: Scenario, ground: Ground) -> MujocoPlant:
    """Return the plant of a scenario on the given ground, after the tractor has settled."""
    assert isinstance(s.plant, Mujoco), s.machine
    with redirect_stderr(io.StringIO()):  # some machines are expected to fall over
        return m.mujoco(s.plant.tyre, ground, s.vehicle)[0]


def tipping_slope(m: Trial, s: Scenario) -> float:
    """Return the slope at which the upper rear wheel lifts off while gravity is tilted [deg]."""
    plant = plant_of(m, s, Flat().ground()._replace(surface=GRIPPING))
    return tilt(plant, True, STEEPEST_DEG, STEADILY_DEG_S).lifted_deg


def stands(m: Trial, s: Scenario, grade_deg: float) -> bool:
    """Return whether the machine is at rest on four wheels after its placement across a slope of `grade_deg`."""
    ground = Slope(grade_deg=grade_deg, direction_deg=90.0).ground()._replace(surface=GRIPPING)
    plant = plant_of(m, s, ground)
    return plant.trouble() is None and float(plant.wheels().reshape(-1, 4)[LOAD].min()) > 0.0


def steepest_start(m: Trial, s: Scenario, about_deg: float) -> float:
    """Return the maximum slope near `about_deg` across which the machine rests after placement [deg]."""
    low, high = about_deg - SOUGHT_DEG, about_deg + SOUGHT_DEG
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stands(m, s, middle) else (low, middle)
    return 0.5 * (low + high)


def drift(m: Trial, s: Scenario, tyre: Any, grade_deg: float) -> float:
    """Return the displacement of a parked machine on a given tyre, with the brake applied [mm]."""
    ground = Slope(grade_deg=grade_deg, direction_deg=DIAGONALLY_DEG) if grade_deg else Flat()
    plant, start = m.mujoco(tyre, ground, s.vehicle)
    *_, end = hold(plant, BRIEFLY_S if m.quick else PARKED_S, BRAKED)
    return 1e3 * dist((start.x, start.y, start.z), (end.x, end.y, end.z))


def deceleration(m: Trial, s: Scenario) -> float:
    """Return the deceleration on level ground with the brake fully applied [m/s2]."""
    plant = plant_of(m, s.changed({"driveline.connected": False}), Flat().ground())
    speed = min(FASTEST_M_S, 0.9 * s.driveline.full_speed_m_s)
    return braking.deceleration(plant, 1.0, speed, FROM * speed, TO * speed)


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of start, parking and braking of each machine, and of parking on each tyre. Quick mode tests two
    machines and parks for 30 s."""
    for machine in QUICK if m.quick else machine_files():
        yield from _machine(m, bare(machine), machine)
    for kind, tyre in families()["plant.tyre"].items():
        for grade in GRADES_DEG:
            about = m.about(f"drift under the brake, {grade:g} deg", kind, "mm")
            yield about.below(drift(m, bare("compact"), tyre(), grade), DRIFT_MM)


def _machine(m: Trial, s: Scenario, name: str) -> Iterator[Check]:
    assert isinstance(s.plant, Mujoco), name
    tyre, tips = s.plant.tyre, tipping_slope(m, s)
    about = m.about(f"steepest slope across which it starts, {name}", tyre.kind, "deg")
    yield about.close(steepest_start(m, s, tips), tips, BAND_DEG)
    for grade in GRADES_DEG:
        about = m.about(f"drift under the brake, {grade:g} deg, {name}", tyre.kind, "mm")
        yield about.below(drift(m, s, tyre, grade), DRIFT_MM)
    about = m.about(f"deceleration by the brake, {name}", tyre.kind, "m/s2")
    yield about.above(deceleration(m, s), BRAKING_M_S2).judged(s.driveline.brake_front_share > 0.0)
