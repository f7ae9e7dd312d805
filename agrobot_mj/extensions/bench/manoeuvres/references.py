"""Published reference values

Results are compared with published numbers. Four loaded radii of tyres with given size codes come from a dealer of
row-crop wheels [BWT2026]. For these tyres, the usual loads at 1.6 bar are assumed. The fifth radius is from a data
sheet that gives load and pressure [Mitas2026]. A table for farmers [Arizona2026] gives the maximum efficiency of
utility tractors with rear-wheel drive, and the slip at this efficiency. The efficiency is drawbar power divided by
power at the power take-off. The calculation includes load transfer, gear losses and tyre sizes of this class. The
tip-over angle of every machine is reported next to the limit of 38 degrees that narrow tractors must reach in a
stability test [OECD2012]. This angle has no acceptance limits, because the methods differ.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.resources import machine_files
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.machine.tyre_size import tyre_size
from agrobot_mj.scenario import load_scenario
from agrobot_mj.tyres import Soil
from agrobot_mj.tyres.base import Footing, Slip
from agrobot_mj.tyres.laws import tyre_set


class LoadedRadius(NamedTuple):
    """Published loaded radius of a tyre at a load and inflation pressure."""

    code: str
    load_kg: float  # Load [kg]
    pressure_bar: float  # Inflation pressure [bar]
    printed_m: float  # Published loaded radius [m]


RADII = (
    LoadedRadius("380/90R46", 3000, 1.6, 0.846),
    LoadedRadius("380/90R50", 3250, 1.6, 0.888),
    LoadedRadius("380/90R54", 3450, 1.6, 0.930),
    LoadedRadius("650/65R42", 4250, 1.6, 0.858),
    LoadedRadius("12-16.5", 2800, 5.52, 0.3835),
)
"""Published loaded radii: from [BWT2026] with assumed loads, and in the last line from [Mitas2026]."""
SOILS = {
    "firm": (1200.0, 0.72, (8.0, 10.0)),
    "tilled": (900.0, 0.67, (11.0, 13.0)),
    "soft": (450.0, 0.55, (14.0, 16.0)),
}
"""Cone index [kPa] (assumed value), published efficiency [-] and slip range [%], by soil [Arizona2026]."""
RADIUS_BAND, EFFICIENCY_ROOM, SLIP_ROOM = 0.015, 0.1, 4.0
"""Acceptance limits of loaded radius [relative], efficiency [-], and deviation from the published slip range [%]."""
GEARS = 0.96  # Power at the axle divided by power at the power take-off [-]. Assumed value (range 0.94-0.97).
STABILITY_DEG = 38.0  # Minimum angle of the lateral stability test of narrow tractors [deg] [OECD2012]
TYRES = {"front_tyre": "380/70R24", "rear_tyre": "480/70R34"}  # Tyre sizes of the utility class


class Pull(NamedTuple):
    """Operating point of a tractor with rear-wheel drive that pulls a load."""

    slip: float  # Slip of the rear wheels [%]
    efficiency: float  # Drawbar power divided by power at the power take-off [-]


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of loaded radii and traction, followed by reported tip-over angles without limits."""
    for tyre in RADII:
        size = tyre_size(tyre.code)
        loaded = size.diameter / 2 - GRAVITY * tyre.load_kg / size.stiffness(tyre.pressure_bar)
        yield m.about(f"loaded radius, {tyre.code}", "size code", "m").near(loaded, tyre.printed_m, RADIUS_BAND)
    tractor = load_scenario("straight_line", {"machine": "utility"}).tractor
    sized = TractorParameters(**(tractor.model_dump(exclude_none=True) | TYRES))
    for name, (kpa, printed, (low, high)) in SOILS.items():
        best = best_pull(sized, kpa)
        about = m.about(f"maximum efficiency of rear-wheel drive, {name} soil", "soil", "")
        yield about.close(best.efficiency, printed, EFFICIENCY_ROOM)
        about = m.about(f"slip at maximum efficiency, {name} soil", "soil", "%")
        yield about.between(best.slip, low - SLIP_ROOM, high + SLIP_ROOM)
    for machine in machine_files():
        scenario = load_scenario("straight_line", {"machine": machine})
        about = m.about(f"theoretical tip-over angle, {machine}", "linear", "deg")
        yield about.reported(Tractor(scenario.tractor).tipping_deg, STABILITY_DEG)


def best_pull(tractor: TractorParameters, cone_index_kpa: float) -> Pull:
    """Return the operating point of maximum efficiency on soil with a cone index [kPa]."""
    pulls = [pull_at(tractor, cone_index_kpa, slip) for slip in np.linspace(0.01, 0.4, 196)]
    return max(pulls, key=lambda pull: pull.efficiency)


def pull_at(tractor: TractorParameters, cone_index_kpa: float, slip: float) -> Pull:
    """Return the operating point at a slip of the rear wheels [-], including the load transfer due to the pull."""
    tyres, footing = tyre_set(Soil(cone_index_kpa=cone_index_kpa), tractor), Footing(1.0, 1e3 * cone_index_kpa)
    laws, pull, gross = (tyres.front, tyres.rear), 0.0, 0.0
    for _ in range(20):
        shift = pull * tractor.hitch_height_m / tractor.wheelbase_m / 2
        loads = tractor.front_axle_load / 2 - shift, tractor.rear_axle_load / 2 + shift
        states = [
            # slips refer to the ground speed: 1 / (1 - s) - 1 for a driven wheel
            Slip(-driven / (1.0 - driven), 0.0, load, load / tyres.stiffness[2 * k], 1.0, footing)
            for k, (load, driven) in enumerate(zip(loads, (0.0, slip), strict=True))
        ]
        own = [tyres.rolling_resistance * load for load in loads]
        drag = [-law.drag(state, 1.0) for law, state in zip(laws, states, strict=True)]
        thrust = float(laws[1].force(states[1]).x)
        gross = 2 * (thrust + own[1])
        pull = max(2 * (thrust - drag[1] - drag[0] - own[0]), 0.0)
    return Pull(100 * slip, GEARS * pull * (1.0 - slip) / gross)
