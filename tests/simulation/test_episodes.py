"""Episodes (`Simulation.advance`) give the same bits as single ticks (`Simulation.step`)."""

import random
from typing import Any

import numpy as np
import pytest
from numba import config

from agrobot_mj.plants.bicycle import BicycleState
from agrobot_mj.scenario.loading import load_scenario, scenario_files
from agrobot_mj.scenario.reference import families
from agrobot_mj.simulation.snapshot import loop_state
from agrobot_mj.simulation.stepping import Simulation

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
RECOMMENDED = {
    "guidance.kind": "lqr",
    "estimator.kind": "ekf_full",
    "sensors.imu.enabled": True,
    "sensors.gyro.enabled": True,
    "sensors.wheel_speed.enabled": True,
    "supervisor.enabled": True,
    "physics": "fast",
}
SENSORS = {key: value for key, value in RECOMMENDED.items() if key.startswith("sensors")}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "paper": ("figure_eight", {}),
    "recommended": ("figure_eight", RECOMMENDED),
    "pi": ("figure_eight", {"controller.kind": "pi"}),
    "pd and ekf_bias": ("figure_eight", {"controller.kind": "pd", "estimator.kind": "ekf_bias"}),
    "pd_isgn": ("figure_eight", {"controller.kind": "pd_isgn", "gains": "tuned"}),
    "pd_t1fnn": ("figure_eight", {"controller.kind": "pd_t1fnn", "gains": "tuned"}),
    "feedforward": ("figure_eight", {"guidance.kind": "feedforward"}),
    "stanley": ("side_slope_10", {**SENSORS, "guidance.kind": "stanley", "estimator.kind": "ekf_full"}),
    "terrain compensation": ("side_slope_10_compensated", {}),
    "antenna ahead": ("figure_eight", {**RECOMMENDED, "tractor.antenna_ahead_m": 0.8, "tractor.antenna_left_m": 0.2}),
    "two antennas": ("figure_eight", {**RECOMMENDED, "sensors.gnss.dual_antenna.enabled": True}),
    "fault": ("figure_eight", {**RECOMMENDED, "fault": [{"kind": "gnss_latency", "start_s": 14.0, "latency_s": 0.4}]}),
    "varying force": ("gusts", {"physics": "fast"}),
    "soft soil": ("ruts", {}),
    "carried implement": ("plough", {}),
    "drawn implement": ("seeder_receiver", {}),
    "rolled over": ("rollover", {}),
    "left terrain": ("off_the_field", {}),
    "stuck": ("stuck_on_ice", {}),
    "reverse": ("reverse_into_row", {}),
    "interpreted law": ("slalom", {**RECOMMENDED, "guidance.kind": "pure_pursuit"}),
    "interpreted controller": ("figure_eight", {"controller.kind": "open_loop"}),
    "interpreted estimator": ("figure_eight", {**RECOMMENDED, "estimator.kind": "ukf", "tractor.antenna_left_m": 0.4}),
    "interpreted law and estimator": (
        "side_slope_10",
        {
            "guidance.kind": "pure_pursuit",
            "estimator": {"kind": "ekf_bias", "backend": "filterpy"},
            "sensors.gnss.dual_antenna.enabled": True,
        },
    ),
}


def driven(name: str, overrides: dict[str, Any], ticks: Any) -> Simulation:
    """Return a finished simulation; `ticks()` is the maximum number of ticks of the next call, or 0 for `step`."""
    sim = Simulation(name, overrides)
    sim.reset()
    while not sim.done:
        most = ticks()
        if most:
            sim.advance(most)
        else:
            sim.step()
    return sim


def numbers(value: Any) -> Any:
    """Return the arrays of a plant state as bytes."""
    arrays = value.arrays if isinstance(value, BicycleState) else (value.physics, *value.memories)
    return [np.ascontiguousarray(part).tobytes() for part in arrays]


def check_equal(a: Simulation, b: Simulation) -> None:
    assert (a.outcome, a.reason, a.rows.filled) == (b.outcome, b.reason, b.rows.filled)
    for name in ("values", "poses"):
        first, second = (getattr(sim.rows, name)[: sim.rows.filled] for sim in (a, b))
        assert np.ascontiguousarray(first).tobytes() == np.ascontiguousarray(second).tobytes()
    assert numbers(loop_state(a.loop).plant) == numbers(loop_state(b.loop).plant)


@pytest.mark.parametrize("case", CASES)
def test_episodes_equal_single_ticks_bit_for_bit(case):
    name, overrides = CASES[case]
    overrides = overrides if load_scenario(name).expected_outcome != "completed" else {**overrides, "duration_s": 20.0}
    single, episodes = driven(name, overrides, lambda: 0), driven(name, overrides, lambda: 200)
    check_equal(single, episodes)


KINDS = families()
BICYCLE: list[dict[str, Any]] = [
    *({"guidance.kind": kind} for kind, law in KINDS["guidance"].items() if not law.outside),
    *({"controller.kind": kind} for kind in KINDS["controller"]),
    *({"estimator.kind": kind, "guidance.kind": "lqr", "seed": 7} for kind in KINDS["estimator"]),
    *(
        {"fault": [{"kind": kind, "start_s": 7.0, "end_s": 8.0}], "seed": 3}
        for kind, fault in KINDS["fault"].items()
        if not fault.machine
    ),
]


@pytest.mark.parametrize("overrides", BICYCLE, ids=str)
def test_episodes_of_the_bicycle_equal_single_ticks_bit_for_bit(overrides):
    overrides = {**SENSORS, "plant.kind": "bicycle", "duration_s": 11.0, **overrides}
    check_equal(driven("figure_eight", overrides, lambda: 0), driven("figure_eight", overrides, lambda: 200))


@pytest.mark.parametrize(
    "kind", ["friction", "payload", "valve_wear", "drawbar", "side_force", "soft_tyre", "gnss_loss"]
)
def test_episodes_after_the_end_of_a_fault_equal_single_ticks(kind):
    """The conditions of a fault act on the plant until the end of the tick in which the fault ends."""
    overrides = {"fault": [{"kind": kind, "start_s": 7.0, "end_s": 9.0}], "duration_s": 16.0}
    check_equal(driven("figure_eight", overrides, lambda: 0), driven("figure_eight", overrides, lambda: 200))


def test_measurement_after_a_divergence_is_from_the_last_complete_tick():
    """Upward gravity accelerates the tractor until the plant diverges."""
    found = []
    for most in (0, 200):
        sim = Simulation("figure_eight", {"duration_s": 40.0, "physics": "fast"})
        sim.reset()
        for _ in range(60):
            sim.step()
        sim.loop.plant.model.opt.gravity[2] = 14.0
        while not sim.done:
            sim.advance(most)
        assert sim.outcome == "diverged"
        found.append((sim.measurement.t, sim.situation.t, sim.estimate.x, sim.reference, sim.truth.t, sim.rows.filled))
    assert found[0] == found[1]


def test_repeated_episodes_from_a_restored_state_are_not_paused():
    sim = Simulation("figure_eight", {"duration_s": 60.0})
    sim.reset()
    while sim.rows.filled < 100:
        sim.advance(100 - sim.rows.filled)
    state = sim.save()
    for _ in range(3):
        sim.restore(state)
        sim.advance()
        assert sim.rows.filled == 300


@pytest.mark.slow
@pytest.mark.parametrize("name", scenario_files())
def test_episodes_of_library_scenarios_equal_single_ticks(name):
    scenario = load_scenario(name)
    if scenario.guidance.outside:
        pytest.skip("an outside program drives")
    overrides = {} if scenario.expected_outcome != "completed" else {"duration_s": 40.0}
    check_equal(driven(name, overrides, lambda: 0), driven(name, overrides, lambda: 200))


@pytest.mark.parametrize("case", ["paper", "recommended", "drawn implement"])
def test_single_ticks_and_episodes_of_any_length_may_alternate(case):
    name, overrides = CASES[case]
    choice = random.Random(7)
    mixed = driven(name, {**overrides, "duration_s": 20.0}, lambda: choice.choice((0, 0, 1, 3, 20, 200)))
    check_equal(driven(name, {**overrides, "duration_s": 20.0}, lambda: 0), mixed)


def test_episodes_after_restore_and_branch_equal_single_ticks():
    sims = [Simulation("figure_eight", {**RECOMMENDED, "duration_s": 15.0}) for _ in range(2)]
    for sim in sims:
        sim.reset()
    sims[0].advance(120)
    while sims[0].rows.filled < 120:
        sims[0].advance(120 - sims[0].rows.filled)
    sims[1].restore(sims[0].save())
    for sim in sims:
        sim.branch(3)
    while not sims[0].done:
        sims[0].advance()
    while not sims[1].done:
        sims[1].step()
    check_equal(*sims)


def test_episodes_with_implausible_fixes_equal_single_ticks():
    overrides = {"sensors.gnss.sigma_m": 4e6, "duration_s": 12.0}
    check_equal(driven("figure_eight", overrides, lambda: 0), driven("figure_eight", overrides, lambda: 200))


def test_episodes_perform_most_ticks_of_a_run_without_faults():
    sim, lengths = Simulation("figure_eight", {"duration_s": 30.0}), []
    sim.reset()
    while not sim.done:
        before = sim.rows.filled
        sim.advance()
        lengths.append(sim.rows.filled - before)
    assert sum(n for n in lengths if n > 1) > 0.95 * sum(lengths)


@pytest.mark.parametrize("ticks", [1.5, "3", None])
def test_number_of_ticks_must_be_an_integer(ticks):
    sim = Simulation("figure_eight", {"duration_s": 2.0})
    sim.reset()
    with pytest.raises(TypeError, match="ticks: must be a whole number"):
        sim.advance(ticks)
