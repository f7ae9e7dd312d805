"""Sliding wheels

A rear wheel on the rig carries its static load. The wheel is either locked and pulled at an angle to its heading, or
spins while moving sideways. Friction acts opposite to the sliding velocity (v_x - v_rim, v_y). Above 80 % slip, the
force may deviate from this direction by at most 5 degrees. The tolerance includes the motion resistance of soil, which
acts along the heading. On soil, the net traction must agree with the standard [ASAE2003] up to 95 % slip,

    F_x / W = 0.88 (1 - exp(-0.1 B_n)) (1 - exp(-7.5 s)) - 1 / B_n - 0.5 s / sqrt(B_n),

with the forward force F_x, load W, slip s and mobility number B_n of the soil. Every tyre must dissipate power.
`linear` has unlimited grip, so its force direction has no acceptance limit.
"""

from collections.abc import Iterator
from math import acos, atan2, cos, degrees, exp, hypot, radians, sin, sqrt
from typing import Any

from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, force_tyres
from agrobot_mj.extensions.bench.rig import REAR, Rig, Setting
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres import Linear, Soil

LOCKED_DEG = (20.0, 45.0, 70.0, 80.0)  # Angles between the velocity of a locked wheel and its heading [deg]
SPINNING = (0.83, 0.9, 0.95)  # Slip of spinning wheels: rim speed minus ground speed, divided by rim speed [-]
SIDE = 0.5  # Lateral velocity of a spinning wheel divided by its forward velocity [-]
SPEEDS_M_S = (0.05, 0.5, 4.0)
LEAN_DEG = 5.0  # Maximum angle between the force and the direction opposite to the sliding velocity [deg]
TRACTION = 0.005  # Maximum error of the net traction divided by the load [-]
TRACTOR = TractorParameters()
LOAD_N = TRACTOR.rear_axle_load / 2


def lean(tyre: Any, forward: float, left: float, rim: float) -> float:
    """Return the angle between the tyre force and the direction opposite to sliding [deg], for the forward and leftward
    speed of the wheel centre and the speed of its rim [m/s]."""
    setting = Setting(forward, atan2(left, forward), rim / forward - 1.0, LOAD_N)
    reading = Rig(tyre, TRACTOR, REAR).steady(setting)
    power = reading.fx * (rim - forward) - reading.fy * left
    share = power / (hypot(reading.fx, reading.fy) * hypot(rim - forward, left))
    return degrees(acos(min(share, 1.0)))


def traction(soil: Soil, s: float) -> float:
    """Return the net traction of the rear wheel at slip `s` divided by its load [-], by the formula of [ASAE2003]."""
    W, b, d = LOAD_N, TRACTOR.rear_wheel_width_m, 2 * TRACTOR.rear_wheel_radius_m
    h, delta = soil.section_height_share * b, W / TRACTOR.rear_wheel.stiffness
    B_n = 1e3 * soil.cone_index_kpa * b * d / W * (1 + 5 * delta / h) / (1 + 3 * b / d)
    return 0.88 * (1 - exp(-0.1 * B_n)) * (1 - exp(-7.5 * s)) - 1 / B_n - 0.5 * s / sqrt(B_n)


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of force directions with every tyre, and of traction on soil. Quick mode tests one speed."""
    speeds = SPEEDS_M_S[1:2] if m.quick else SPEEDS_M_S
    pulled = [(v * cos(radians(a)), v * sin(radians(a)), 0.0) for v in speeds for a in LOCKED_DEG]
    spun = [(v, v * SIDE, v / (1 - s)) for v in speeds for s in SPINNING]
    for tyre in force_tyres():
        for name, motions in (("locked, 20-80 deg to its heading", pulled), ("spinning, 83-95 % slip", spun)):
            found = max(lean(tyre, *motion) for motion in motions)
            off = m.about(f"deviation of the force from the sliding direction, {name}", tyre.kind, "deg").below(
                found, LEAN_DEG
            )
            yield off.judged(not isinstance(tyre, Linear))
            yield m.about(f"fraction of the force that dissipates power, {name}", tyre.kind).above(
                cos(radians(found)), 0.0
            )
        for s in (0.3, 0.6, 0.9, 0.95) if isinstance(tyre, Soil) else ():
            pull = Rig(tyre, TRACTOR, REAR).steady(Setting(1.0, 0.0, s / (1 - s), LOAD_N)).fx / LOAD_N
            about = m.about(f"net traction divided by load at {100 * s:g} % slip", tyre.kind)
            yield about.close(pull, traction(tyre, s), TRACTION)
