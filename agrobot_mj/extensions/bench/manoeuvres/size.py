"""Tyres and steering by the size of the machine

Tractors of 0.7 to 9 t are scaled in proportion: lengths with the cube root of the mass, inertias with mass times length
squared. Tyre and steering properties follow from load and size. The manoeuvres check these requirements:

- All tractors have the same crab angle alpha across a slope: sin(grade) = (w_f k_f + w_r k_r) alpha. k is the stiffness
  of an axle divided by its static load, w the fraction of the weight on the axle.
- At the static load of a wheel, the peak force is mu times this load.
- The steering torque at standstill is proportional to load times tyre width, as steering manufacturers state
  [Eaton2006]. The wheels reach their stops.
- A trailer with half the mass of the tractor and the tyre law of the rear wheels stays in line with the tractor.
"""

from collections.abc import Iterator
from math import atan, cos, degrees, radians, tan

import numpy as np

from agrobot_mj.core.signals import NEUTRAL_V
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, machine_of_mass, scale_to_mass
from agrobot_mj.extensions.bench.manoeuvres.theory import crab_of_any_mass
from agrobot_mj.extensions.bench.rig.wheel import FRONT, REAR, Rig, Setting, static_load
from agrobot_mj.machine import Machine, TractorParameters
from agrobot_mj.machine.implements import Drawn
from agrobot_mj.machine.linkage import UPRIGHT
from agrobot_mj.plants.driver import Driver, track_course
from agrobot_mj.terrain import Slope
from agrobot_mj.tyres import MagicFormula

MASSES_KG = (700.0, 2000.0, 5000.0, 9000.0)
GRADE_DEG, SPEED_M_S = 5.0, 1.2
BAND, PARKED_BAND, HITCH_DEG = 0.03, 0.15, 0.1
"""Acceptance limits of crab angle and peak force [relative], parking torque [relative], and hitch angle [deg]."""
TYRE = MagicFormula()
PEAKS_DEG = np.arange(5.0, 41.0, 1.0)  # Slip angles at which the force is computed to find its peak [deg]


def crab(m: Trial, machine: Machine) -> tuple[float, float]:
    """Return the mean slip angle of both axles, weighted by stiffness, and the hitch angle (0 without an implement)
    [deg]."""
    plant, truth = m.mujoco(TYRE, Slope(grade_deg=GRADE_DEG, direction_deg=90.0), machine)
    # equal speed in wheelbases per second, because the driver's gains are those of a compact tractor
    speed = SPEED_M_S * machine.tractor.wheelbase_m / TractorParameters().wheelbase_m
    trace, folded = Driver(plant, truth, speed).go(25.0, track_course()), 0.0
    heading = atan(tan(trace.mean("yaw", 3.0)) / cos(radians(GRADE_DEG)))
    share = machine.tractor.front_load_fraction
    front, rear = share * TYRE.front.lateral.stiffness_per_load, (1 - share) * TYRE.rear.lateral.stiffness_per_load
    weighted = heading + front / (front + rear) * trace.mean("steer", 3.0)
    if plant.has_implement:
        names = [column.name for column in plant.columns]
        folded = float(plant.report()[names.index("hitch_angle")])
    return degrees(weighted), degrees(folded)


def peak(tractor: TractorParameters, wheel: int) -> float:
    """Return the maximum lateral force of a wheel divided by its static load [-]."""
    rig, load = Rig(TYRE, tractor, wheel), static_load(tractor, wheel)
    return max(-rig.steady(Setting(SPEED_M_S, radians(angle), 0.0, load)).fy for angle in PEAKS_DEG) / load


def parking_torque(m: Trial, machine: Machine) -> tuple[float, float]:
    """Steer a parked tractor to its left stop. Return the mean steering torque [N m] and the final steering angle
    [deg]."""
    driver = Driver(*m.mujoco(TYRE, machine=machine))
    torques = machine.cylinder.displacement * driver.pressures(1.0, NEUTRAL_V + 2.0)
    driver.go_by_voltage(4.0, 2 * NEUTRAL_V)
    return float(np.mean(torques[12:])), degrees(driver.truth.steer)


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the default tractor scaled to several masses. Quick mode tests every second mass."""
    for mass in MASSES_KG[1::2] if m.quick else MASSES_KG:
        machine, size = machine_of_mass(mass), f"{mass / 1e3:g} t"
        tractor = machine.tractor
        slipped, _ = crab(m, machine)
        _, folded = crab(m, machine._replace(implement=scale_to_mass(Drawn(), mass / 2)))
        torque, reached = parking_torque(m, machine)
        about = m.about(f"mean crab angle, {GRADE_DEG:g} deg, {size}", TYRE.kind, "deg")
        yield about.near(slipped, crab_of_any_mass(tractor, TYRE, GRADE_DEG), BAND)
        for axle, wheel, curve in (("front", FRONT, TYRE.front), ("rear", REAR, TYRE.rear)):
            about = m.about(f"peak force divided by static load, {axle}, {size}", TYRE.kind)
            yield about.near(peak(tractor, wheel), curve.lateral.mu, BAND)
        yield m.about(f"angle of a trailer to the tractor, {size}", TYRE.kind, "deg").below(folded, HITCH_DEG)
        about = m.about(f"steering torque at standstill, {size}", TYRE.kind, "N m")
        yield about.near(torque, UPRIGHT.parked_torque(tractor), PARKED_BAND)
        yield m.about(f"steering angle reached at standstill, {size}", TYRE.kind, "deg").close(
            reached, tractor.steer_limit_deg, 0.2
        )
