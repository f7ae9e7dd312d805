"""Data sheet of a machine without an implement, measured in the simulator on firm ground, as on a proving ground.

Loads are measured at standstill. The turning circle refers to the centre of the rear axle at full lock and crawling
speed. The steering rate is measured at full voltage while rolling, the understeer gradient as in ISO 4138 on a circle
of 20 wheelbases. The tip-over angle is measured by raising one side on ground with sufficient grip. The brake and the
drive are tested on a slope that increases until the machine rolls off or cannot climb.

Each parameter of a machine has a basis: measured, printed, identified or assumed. The basis of a key in the machine
file is the first word of its comment, or of the comment above if the key has no comment. For a key that is not set in
the file, the docstring of the key states the basis. Values computed from the machine size have the basis "assumed".
"""

import re
from collections.abc import Iterator
from math import cos, degrees, hypot, isfinite, nan, radians, sin
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, Drive
from agrobot_mj.core.spec import Spec
from agrobot_mj.extensions.bench.manoeuvres.cornering import circle
from agrobot_mj.extensions.bench.manoeuvres.steering import angles
from agrobot_mj.extensions.bench.manoeuvres.tipping import GRIPPING, STEEPEST_DEG, tilt
from agrobot_mj.machine.hydraulics import FULL_RANGE_V
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants import Clock, Mujoco, MujocoPlant
from agrobot_mj.plants.driver import ORIGIN, REST, Driver, hold
from agrobot_mj.plants.mujoco.views import CHASSIS
from agrobot_mj.scenario import Scenario, load_scenario
from agrobot_mj.scenario.machines import machine_file
from agrobot_mj.simulation.feasibility import naming
from agrobot_mj.terrain import Flat, Ground
from agrobot_mj.tyres.patch import LOAD

LEVEL = Flat().ground()
CREEPING_M_S, ROLLING_M_S, SLIPPING_M_S = 0.5, 1.0, 0.005
"""Maximum speed of the turning and climbing tests, maximum speed of the steering test, and speed above which braked
wheels count as slipping [m/s]. While only one axle slips, the mean wheel speed is 1-4 mm/s."""
CIRCLE_WHEELBASES, FASTEST_M_S = 20.0, 4.0
"""Radius of the circle for the understeer gradient [wheelbases], and maximum speed on this circle [m/s]. The speed is
also limited to 80 % of the top speed of the machine."""
QUICKLY_DEG_S, SLOWLY_DEG_S, SLOWLY_FROM_DEG = 4.0, 0.25, 15.0
"""Rates at which the test slope increases below and above `SLOWLY_FROM_DEG` [deg/s], and this slope [deg]."""
CLIMBING = 0.7
"""Fraction of the initial speed below which a machine counts as unable to climb the slope [-]."""
STEADY_S = 10.0  # Time at constant pedal position until oscillations of the crawling machine have decayed [s]


class Measured(NamedTuple):
    """Measured quantity, which is one line of a data sheet."""

    name: str
    value: float  # Measured value [`unit`]
    unit: str

    @property
    def written(self) -> dict[str, str | float | None]:
        """Name, value and unit as JSON values. The value has six significant digits, or is None if it is not finite."""
        return {**self._asdict(), "value": float(f"{self.value:.6g}") if isfinite(self.value) else None}


def data_sheet(machine: str) -> Iterator[Measured]:
    """Measure a machine, given by name or path, and yield the lines of its data sheet.

    Raises `ScenarioError` for an unknown machine, or if the plant is not the MuJoCo plant.
    """
    scenario = load_scenario("straight_line", {"machine": machine, "implement": {"kind": "none"}})
    if not isinstance(scenario.plant, Mujoco):
        raise ScenarioError(f"{machine}: plant.kind: a data sheet needs the MuJoCo plant")
    with naming(machine):
        _plant(scenario)
    yield from _standing(scenario)
    yield from _turning(scenario)
    yield Measured("understeer gradient", _understeer(scenario), "deg s2/m")
    gripping = _plant(scenario, LEVEL._replace(surface=GRIPPING))
    yield Measured("tip-over angle, sideways", tilt(gripping, True, STEEPEST_DEG).lifted_deg, "deg")
    yield Measured("slope that the brake holds", _holding(scenario), "deg")
    yield Measured("slope that it climbs", _climbing(scenario), "deg")
    yield Measured("top speed", _top_speed(scenario), "m/s")


def _plant(scenario: Scenario, ground: Ground = LEVEL) -> MujocoPlant:
    assert isinstance(scenario.plant, Mujoco)
    plant = MujocoPlant(scenario.plant, scenario.vehicle, ground, Clock.of(scenario.step_s))
    plant.reset(ORIGIN)
    return plant


def _driver(scenario: Scenario, speed: float) -> Driver:
    plant = _plant(scenario)
    return Driver(plant, plant.truth(), speed, scenario.driveline.full_speed_m_s)


def _standing(scenario: Scenario) -> Iterator[Measured]:
    plant = _plant(scenario)
    *_, _ = hold(plant, 1.0)
    loads = plant.wheels().reshape(-1, 4)[LOAD]
    yield Measured("mass", float(plant.model.body_subtreemass[CHASSIS]), "kg")
    yield Measured("front axle load", float(loads[:2].sum()) / 1e3, "kN")
    yield Measured("rear axle load", float(loads[2:].sum()) / 1e3, "kN")


def _turning(scenario: Scenario) -> Iterator[Measured]:
    """Yield the turning radius at full lock, and the steering rates from lock to lock in both directions."""
    driver = _driver(scenario, min(ROLLING_M_S, 0.5 * scenario.driveline.full_speed_m_s))
    driver.go(3.0)
    rates = []
    for side in (-1, 1):
        driver.go_by_voltage(6.0, NEUTRAL_V - side * FULL_RANGE_V / 2)
        rates.append(_rate(driver, side))
    driver.speed = min(CREEPING_M_S, driver.speed)
    trace = driver.go(10.0, scenario.tractor.steer_limit)
    yield Measured("turning radius of the rear axle", trace.mean("speed", 5.0) / trace.mean("yaw_rate", 5.0), "m")
    yield Measured("steering rate, right", rates[0], "deg/s")
    yield Measured("steering rate, left", rates[1], "deg/s")


def _rate(driver: Driver, side: int) -> float:
    seen = angles(driver.go_by_voltage(6.0, NEUTRAL_V + side * FULL_RANGE_V / 2))
    middle = np.flatnonzero(abs(seen) < radians(10.0))
    step = TICK_S / driver.truth.steer_samples.size
    return side * degrees(float(np.polyfit(step * middle, seen[middle], 1)[0]))


def _understeer(scenario: Scenario) -> float:
    """Return the understeer gradient on a circle: change of steering angle per lateral acceleration [deg s2/m]."""
    driver = _driver(scenario, 0.0)
    speeds = min(FASTEST_M_S, 0.8 * driver.full_speed) * np.arange(1, 5) / 4
    rows = circle(driver, 15.0, CIRCLE_WHEELBASES * scenario.tractor.wheelbase_m, speeds)
    return degrees(float(np.polyfit(rows[:, 0], rows[:, 1], 1)[0]))


def _slope(plant: MujocoPlant) -> Iterator[float]:
    """Increase an uphill slope in each tick by tilting gravity backwards. Yield the slope of each tick [deg]."""
    grade = 0.0
    while grade < STEEPEST_DEG:
        grade += TICK_S * (QUICKLY_DEG_S if grade < SLOWLY_FROM_DEG else SLOWLY_DEG_S)
        plant.model.opt.gravity[:] = -GRAVITY * sin(radians(grade)), 0.0, -GRAVITY * cos(radians(grade))
        yield grade


def _holding(scenario: Scenario) -> float:
    """Return the slope [deg] on which the brake of a machine facing uphill begins to slip, or NaN if it always
    holds."""
    plant = _plant(scenario.changed({"driveline.connected": False}))
    braked = Drive(NEUTRAL_V, NEUTRAL_V, 1.0)
    return next((grade for grade in _slope(plant) if abs(plant.advance(braked).wheel_speed) > SLIPPING_M_S), nan)


def _climbing(scenario: Scenario) -> float:
    """Return the slope [deg] on which a crawling machine at constant pedal slows down to the fraction `CLIMBING` of its
    initial speed, or NaN if it never does."""
    driver = _driver(scenario, CREEPING_M_S)
    driver.go(5.0)
    *_, steady = hold(driver.plant, STEADY_S)  # oscillations of large, light machines decay
    lowest = CLIMBING * steady.speed
    return next((grade for grade in _slope(driver.plant) if driver.plant.advance(REST).speed < lowest), nan)


def _top_speed(scenario: Scenario) -> float:
    """Return the speed at full pedal on level ground [m/s]."""
    *_, truth = hold(_plant(scenario), 15.0, Drive(NEUTRAL_V, FULL_RANGE_V))
    return hypot(truth.speed, truth.lateral_speed)


def sheet_text(measured: Measured) -> str:
    """Return one line of a data sheet as text: name, value with four significant digits, and unit."""
    rounded = float(f"{measured.value:.4g}")  # no exponent for ten tonnes
    return f"{measured.name:32} {rounded:9g} {measured.unit}".rstrip()


SAYS = {
    "measured": r"(Log|Measured)\b",
    "identified": r"Identified\b",
    "assumed": r"(Estimate|Assumed)\b|.*\bAssumed value\b",
    "printed": r"(Maker|Print|Printed|Code|Paper)\b|\[[A-Z][A-Za-z]+\d{4}",
}
"""Regular expressions that recognize the basis of a parameter at the start of its comment in a machine file, by
basis."""
CITED = re.compile(r"\[[A-Z][A-Za-z]+\d{4}|Paper,")
UNKNOWN = "not stated"  # Basis of a value for which the machine file has no comment
_TABLE, _KEY = re.compile(r"\s*\[([\w.]+)\]\s*(?:#\s*(.*))?$"), re.compile(r"\s*([\w.]+)\s*=[^#]*(?:#\s*(.*))?$")


class Basis(NamedTuple):
    """Machine parameter with its value and the basis of this value, for example `measured` or `assumed`."""

    key: str
    value: float  # Value in the unit of the key
    basis: str  # Basis of the value: a key of `SAYS`, or `UNKNOWN`


def bases(machine: str, scenario: Scenario) -> Iterator[Basis]:
    """Yield a `Basis` for each numerical parameter of the tractor, the steering and the driveline. `machine` is the
    name or the path of a machine file."""
    found = machine_file(machine)
    stated = {} if found is None else comments(found[0].read_text(encoding="utf-8"))
    for table, part in (
        ("tractor", scenario.tractor),
        ("steering.valve", scenario.steering.valve),
        ("steering.cylinder", scenario.steering.cylinder),
        ("steering.linkage", scenario.steering.linkage),
        ("driveline", scenario.driveline),
    ):
        for name in type(part).model_fields:
            value = getattr(part, name)
            if isinstance(value, int | float) and not isinstance(value, bool):
                key = f"{table}.{name}"
                yield Basis(key, float(value), stated.get(key) or of_default(part, name))


def comments(text: str) -> dict[str, str]:
    """Return the basis of each parameter in the text of a machine file, by dotted key, for example
    `tractor.mass_kg`."""
    table, last, found = "", UNKNOWN, dict[str, str]()
    for line in text.splitlines():
        if header := _TABLE.match(line):
            table, last = header[1], basis_of(header[2] or "")
        elif key := _KEY.match(line):
            last = basis_of(key[2]) if key[2] else last
            found[f"{table}.{key[1]}" if table else key[1]] = last
    return found


def basis_of(comment: str) -> str:
    """Return the basis stated at the start of a comment (a key of `SAYS`), or `UNKNOWN`."""
    return next((basis for basis, pattern in SAYS.items() if re.match(pattern, comment)), UNKNOWN)


def of_default(part: Spec, name: str) -> str:
    """Return the basis of a parameter that is not set in the machine file. The basis is "printed" for a default value
    whose docstring cites a source, otherwise "assumed"."""
    text, default = type(part).describe(name), type(part).model_fields[name].default
    if "Assumed value" in text or name in part.sized or getattr(part, name) != default:
        return "assumed"
    return "printed" if CITED.search(text) else "assumed"


def basis_text(found: Basis) -> str:
    """Return one line of text with the key, the value and the basis of a parameter."""
    return f"{found.key:40} {float(f'{found.value:.4g}'):9g} {found.basis}"
