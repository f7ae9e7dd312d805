"""What is known of a machine before its log is read: tyres of any tractor, sensors of any maker. All estimates."""

from math import radians

from agrobot_mj.fieldlogs.identify.fit import Prior
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters

SLIP_AT_LOAD = Prior(0.1, 0.08)
"""Slip angle at which a lateral force on an axle reaches its load if tyres were linear [rad]: stiffness over load is
5-25 on roads, 2-10 on soil."""
RELAXATION = Prior(1.0, 1.0)
"""Relaxation length over the radius of the wheel [-]: 0.25 on turf at walking speed, up to 3 is published."""
BACKLASH = Prior(0.0, radians(1.5))
"""Play of the steering [rad]."""
SPEED_ERROR = Prior(0.0, 0.02)
"""Error of the speed [-]."""
DELAY_S = 0.3
"""Standard deviation of an age [s]."""
PLACE_M = 0.5
"""Standard deviation of the antenna's place about the map's [m]."""
CENTRE, SCALE = Prior(0.0, radians(5.0)), Prior(1.0, 0.2)
"""What is left of centre [rad] and scale [-] after a straight line has been drawn."""


def priors(tractor: TractorParameters, age: float) -> dict[str, Prior]:
    """Priors of everything that a log may not tell; `age` is that of the yaw rate behind the steering [s]."""
    weight, front = tractor.mass_kg * GRAVITY, tractor.front_load_fraction
    found = {
        f"{axle}_compliance": Prior(SLIP_AT_LOAD.mean / load, SLIP_AT_LOAD.sigma / load)
        for axle, load in (("front", weight * front), ("rear", weight * (1 - front)))
    }
    for axle, radius in (("front", tractor.front_wheel_radius_m), ("rear", tractor.rear_wheel_radius_m)):
        found[f"{axle}_relaxation_m"] = Prior(radius * RELAXATION.mean, radius * RELAXATION.sigma)
    found |= {name: Prior(age, DELAY_S) for name in ("heading_delay_s", "position_delay_s")}
    found |= {name: Prior(0.0, PLACE_M) for name in ("ahead_m", "left_m")}
    return found | {
        "backlash": BACKLASH,
        "speed_error": SPEED_ERROR,
        "speed_delay_s": Prior(0.0, DELAY_S),
        "steer_offset": CENTRE,
        "steer_scale": SCALE,
        "steer_delay_s": Prior(0.0, DELAY_S),
    }
