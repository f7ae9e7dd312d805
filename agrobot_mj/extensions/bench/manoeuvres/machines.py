"""Machines along a side slope

Every machine of `agrobot-mj list --machines` drives `side_slope_10` without its implement and without GNSS noise. The
guidance law of the scenario uses the gains of the section on closed-loop guidance. The machine must be at rest at the
start. While the machine moves, the slip angle of its rear wheels must correspond to their fraction of m g sin(theta).
The theory of the section on the side slope is applied to the dimensions and tyres of the machine. The offset from the
line is compared with the closed form given in the section on closed-loop guidance, evaluated for the measured roll,
crab and steering angles.
"""

from collections.abc import Iterator
from math import atan, cos, degrees, radians, tan
from typing import Any

from agrobot_mj.core.resources import machine_files
from agrobot_mj.extensions.bench.manoeuvres.antenna_lean import GAINS, mean_drive, offset
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor
from agrobot_mj.plants import Mujoco
from agrobot_mj.scenario import Scenario, load_scenario
from agrobot_mj.simulation.run import run as simulate

BAND, ROOM_CM, REST_MM_S = 0.05, 1.0, 1.0  # Acceptance limits: slip angle [relative], offset [cm], initial speed [mm/s]
GRADE_DEG = 10.0
DRIVE_S, SETTLED_S = 120.0, 40.0  # Duration of a run, and of its final part that is evaluated [s]
QUICK = ("compact", "row_crop")
BARE: dict[str, Any] = {
    "implement": {"kind": "none"},
    "estimator": {"kind": "ekf"},  # the closed form is valid for the paper's filter
    **GAINS["pd_t2fnn"],  # gains tuned for the compact tractor let large machines oscillate
    "duration_s": DRIVE_S,
    "path.length_m": 200.0,
    "sensors.gnss.sigma_m": 0.0,
    "sensors.gnss.velocity_sigma_m_s": 0.0,
}


def scenario_of(machine: str) -> Scenario:
    """Return the side-slope scenario of a machine, without its implement and without GNSS noise."""
    return load_scenario("side_slope_10", {"machine": machine, **BARE})


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of every shipped machine. Quick mode tests only the machines in `QUICK`."""
    for machine in QUICK if m.quick else machine_files():
        yield from _on_slope(m, machine)


def _on_slope(m: Trial, machine: str) -> Iterator[Check]:
    scenario = scenario_of(machine)
    assert isinstance(scenario.plant, Mujoco), machine
    tyre, log = scenario.plant.tyre, simulate(scenario)
    found, start = mean_drive(scenario, log, SETTLED_S), 1e3 * abs(float(log.column("speed")[0]))
    slip = degrees(atan(tan(found.state.crab) / cos(radians(GRADE_DEG))))
    yield m.about(f"speed at the start, {machine}", tyre.kind, "mm/s").below(start, REST_MM_S)
    balance = Tractor(scenario.tractor, tyre).side_slope(GRADE_DEG)
    about = m.about(f"slip angle of the rear wheels, {GRADE_DEG:g} deg, {machine}", tyre.kind, "deg")
    yield about.near(slip, degrees(balance.rear_slip), BAND)
    about = m.about(f"offset from the line, {GRADE_DEG:g} deg, {machine}", tyre.kind, "cm")
    yield about.close(100 * found.offset, 100 * offset(scenario, found.state), ROOM_CM)
