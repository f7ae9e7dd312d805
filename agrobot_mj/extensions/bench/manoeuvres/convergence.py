"""Convergence with the physics step

The figure eight is simulated in closed loop with noise, at physics steps of 2 ms and 1 ms. The RMS lateral errors of
both simulations must be nearly equal. Results of the tyre `contact` have no acceptance limits.
"""

from collections.abc import Iterator
from typing import Any

from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, force_tyres, tyres
from agrobot_mj.plants import Mujoco
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.run import run as simulate

STEP_S = 0.002
BRIEFLY_S = 20.0
BAND = 2.0  # Maximum change of the RMS lateral error when the step is halved [%]


def lateral_rms(tyre: Any, dt: float, duration_s: float | None) -> float:
    """Return the RMS lateral error of the CG on the figure eight [m], or infinity if the run does not complete."""
    changes = {"physics_dt_s": dt, **({"duration_s": duration_s} if duration_s else {})}
    scenario = load_scenario("figure_eight", changes).model_copy(update={"plant": Mujoco(tyre=tyre)})
    log = simulate(scenario)
    return float(log.metrics["lateral_rms"]) if log.outcome == "completed" else float("inf")


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the change of the RMS lateral error with the physics step, for every tyre. Quick mode simulates
    only the first `BRIEFLY_S`, on tyres with a force law."""
    for tyre in force_tyres() if m.quick else tyres():
        coarse, fine = (lateral_rms(tyre, dt, BRIEFLY_S if m.quick else None) for dt in (STEP_S, STEP_S / 2))
        change = m.about("change of lateral rms, 2 ms to 1 ms", tyre.kind, "%")
        yield change.below(100 * (coarse - fine) / fine, BAND).judged(tyre.judged)
        yield m.about("lateral rms at 2 ms", tyre.kind, "m").reported(coarse)
