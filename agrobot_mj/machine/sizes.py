"""How large a machine is beside the compact tractor, on which all defaults are: what other keys follow.

A part of a scenario names the keys that follow the size, and how, in `sized`: a look-ahead goes with the length, a
cornering stiffness with the load of its axle. On the compact tractor every ratio is 1.
"""

from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.tractor import COMPACT, TractorParameters


def ratios_of(tractor: TractorParameters, driveline: Driveline) -> dict[str, float]:
    """Wheelbase, track, mass, static loads of the axles and full speed over those of the compact tractor [-]."""
    return {
        "length": tractor.wheelbase_m / COMPACT.wheelbase_m,
        "track": tractor.track_m / COMPACT.track_m,
        "mass": tractor.mass_kg / COMPACT.mass_kg,
        "front_load": tractor.front_axle_load / COMPACT.front_axle_load,
        "rear_load": tractor.rear_axle_load / COMPACT.rear_axle_load,
        "speed": driveline.full_speed_m_s / Driveline().full_speed_m_s,
    }
