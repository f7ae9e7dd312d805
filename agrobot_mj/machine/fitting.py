"""Size of a machine relative to the compact tractor, and warnings about components that are implausible for its weight.

Each class of parameters lists in `sized` the keys that scale with the size of the machine, and their exponents: a
look-ahead distance scales with the length, a cornering stiffness with the axle load. The plausibility limits are wide,
so that all production machines satisfy them.
"""

from collections.abc import Iterator
from math import radians, tan

from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.implements.base import HitchedBody, ImplementBase, wheel_loads
from agrobot_mj.machine.tractor import COMPACT, GRAVITY, AxleWheel, TractorParameters

DEEPEST_SHARE = 0.15
"""Maximum plausible static tyre deflection divided by free radius [-]. Assumed value, about half the section height."""
DENSEST_KPA, DENSEST_DRAWN_KPA = 70.0, 150.0
"""Maximum plausible wheel load divided by tyre width times diameter [kPa], for tractors and for implements. Assumed
values, above the maxima of 45 and 100 in manufacturers' tables."""
LIGHTEST_KN_M3 = 4.0
"""Minimum plausible weight of a machine divided by the sum over its wheels of squared diameter times width [kN/m3].
Assumed value, below the values of quads and light robots (7-10) and of the machines in the library (15-26)."""
HIGHEST_BAR = 250.0  # Maximum pressure of a real steering system [bar]. Assumed value: 100-200 are common.
LEAST_PULL, LEAST_POWER = 0.15, 0.07
"""Minimum plausible driving force divided by weight [-]: at the torque limit, and at the power limit and the path
speed. Assumed values: the rolling resistance is 0.05-0.07 of the weight."""
COMPACT_WIDTH_M = 2.0
"""Working width of the compact tractor, the default of `path.swath_m` [m]. Assumed value (range 1.5-2.5)."""


def fit_warnings(machine: Machine, scrubs: bool, speed: float) -> Iterator[str]:
    """Yield a warning for each component that is implausible for the weight of the machine or the path `speed` [m/s].

    If the tyres resist steering at standstill (`scrubs`), the steering torque is also checked.
    """
    hitched = machine.implement.hitched(machine.tractor)
    yield from _light(machine.tractor)
    yield from _tyres(machine, hitched)
    if scrubs:
        yield from _steering(machine)
    yield from _drive(machine, hitched, speed)


def _light(tractor: TractorParameters) -> Iterator[str]:
    least = 1e3 * LIGHTEST_KN_M3 / GRAVITY * sum(2 * (2 * w.radius) ** 2 * w.width for w in tractor.wheels)
    if tractor.mass_kg < least:
        wheel = tractor.rear_wheel
        size = f"rear wheels of {2 * wheel.radius:.2g} m by {wheel.width:.2g} m"
        fits = f"which fit machines of at least {least:.0f} kg; set the mass, or the radius and width of the wheels"
        yield f"tractor.mass_kg: {tractor.mass_kg:g} kg is too light for {size}, {fits}"


def _tyres(machine: Machine, hitched: HitchedBody | None) -> Iterator[str]:
    for load, wheel in zip(wheel_loads(machine.tractor, hitched), machine.tractor.wheels, strict=True):
        if load / wheel.stiffness > DEEPEST_SHARE * wheel.radius:
            deflects = f"deflects by {1e3 * load / wheel.stiffness:.0f} mm of its radius of {1e3 * wheel.radius:.0f} mm"
            given = getattr(machine.tractor, f"{wheel.axle}_tyre_stiffness_n_m") is not None
            key = "stiffness_n_m" if given else "pressure_bar"
            yield (f"tractor.{wheel.axle}_tyre_{key}: under {load:.0f} N the tyre {deflects}; increase this value")
        yield from _overload_faults(f"tractor.{wheel.axle}_wheel_radius_m", load, wheel, DENSEST_KPA)
    if hitched is not None and (drawn := hitched.axle) is not None:
        yield from _overload_faults("implement", drawn.wheel.load, drawn.wheel, DENSEST_DRAWN_KPA)


def _overload_faults(key: str, load: float, wheel: AxleWheel, most_kpa: float) -> Iterator[str]:
    kpa = load / (2 * wheel.radius * wheel.width) / 1e3
    if kpa > most_kpa:
        carries = f"{2 * wheel.radius:.2g} m by {wheel.width:.2g} m under {load:.0f} N has a pressure of {kpa:.0f} kPa"
        yield f"{key}: a wheel of {carries}, above the limit of {most_kpa:g} kPa; increase its radius or width"


def _steering(machine: Machine) -> Iterator[str]:
    tractor, cylinder = machine.tractor, machine.cylinder
    needed, relief = machine.linkage.parked_torque(tractor), cylinder.column(tractor, machine.linkage).relief_torque
    if relief < needed:
        less = f"the cylinder provides {relief:.0f} N m, but the front wheels need {needed:.0f} N m at standstill"
        yield f"steering.cylinder.relief_pressure_bar: {less}; the tractor can steer only while moving"
    bar = relief / cylinder.displacement / 1e5
    if cylinder.relief_pressure_bar is None and bar > HIGHEST_BAR:
        small = f"too small for this front axle, with a relief pressure of {bar:.0f} bar"
        yield (f"steering.cylinder.bore_mm: {small}; increase the bore and the flows of steering.valve")


def _drive(machine: Machine, hitched: HitchedBody | None, speed: float) -> Iterator[str]:
    tractor, driveline = machine.tractor, machine.driveline
    if not driveline.connected:
        return
    wheels = 0.0 if hitched is None or hitched.axle is None else 2 * hitched.axle.wheel.mass
    hung = 0.0 if hitched is None else hitched.mass + wheels
    weight = GRAVITY * (tractor.mass_kg + hung)
    strength = driveline.strength(tractor)
    pull = strength.torque / tractor.rear_wheel_radius_m / weight
    if pull < LEAST_PULL:
        ratio = f"{pull:.2g} times the weight of {weight:.0f} N"
        yield f"driveline.torque_limit_n_m: the maximum pull is only {ratio}, too low for a slope; increase the limit"
    if speed > 0.0 and (share := strength.power / speed / weight) < LEAST_POWER:
        at = f"at {speed:g} m/s the maximum pull is only {share:.2g} times the weight of {weight:.0f} N"
        yield f"driveline.power_limit_kw: {at}, close to the rolling resistance; increase the limit"


def ratios_of(tractor: TractorParameters, driveline: Driveline, implement: ImplementBase) -> dict[str, float]:
    """Return the dimensions of a machine divided by the dimensions of the compact tractor [-], by name.

    The ratios compare wheelbase, track width, working width, turning radius, mass, static axle loads and full speed.
    The working width is the width of the implement if given; otherwise it scales with the track width.
    """
    track = tractor.track_m / COMPACT.track_m
    given = "width_m" in implement.model_fields_set
    return {
        "length": tractor.wheelbase_m / COMPACT.wheelbase_m,
        "track": track,
        "width": getattr(implement, "width_m", 0.0) / COMPACT_WIDTH_M if given else track,
        "turn": _turning_radius(tractor) / _turning_radius(COMPACT),
        "mass": tractor.mass_kg / COMPACT.mass_kg,
        "front_load": tractor.front_axle_load / COMPACT.front_axle_load,
        "rear_load": tractor.rear_axle_load / COMPACT.rear_axle_load,
        "speed": driveline.full_speed_m_s / Driveline().full_speed_m_s,
    }


def _turning_radius(tractor: TractorParameters) -> float:
    """Return the turning radius of the rear axle [m] at the smaller of the steering limits of this tractor and
    `COMPACT`."""
    return tractor.wheelbase_m / tan(radians(min(tractor.steer_limit_deg, COMPACT.steer_limit_deg)))
