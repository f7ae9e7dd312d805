"""How runs end: each outcome in a run of its own, and what must not pass for one."""

from types import SimpleNamespace

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.signals import TICK_S, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.simulation.outcomes import LOST_M, STUCK_PEDAL, STUCK_S, Watch
from agrobot_mj.studies.validation.driver import Driver
from agrobot_mj.terrain import Ground


def ends(seconds=40.0, source="straight_line", **overrides):
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    return run(load_scenario(source, {"duration_s": seconds, **keys}))


def field(kind="flat", **patch):
    """Ground with a patch of 20 m that begins 10 m ahead."""
    return {"kind": kind, "patch": [{"kind": "rectangle", "x_m": 20.0, "length_m": 20.0, **patch}]}


# --- stuck --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "least_x", "most_x"),
    [
        ({"plant": {"tyre": {"kind": "soil", "cone_index_kpa": 60.0}}}, 0.0, 0.5),
        ({"plant__tyre__kind": "soil", "terrain": field(cone_index_kpa=70.0)}, 9.0, 14.0),
        ({"terrain": {**field("slope", friction=0.1), "grade_deg": 12.0, "direction_deg": 0.0}}, 8.0, 14.0),
        ({"fault": [{"kind": "drawbar", "pull_n": 8000.0, "start_s": 8.0}]}, 5.0, 9.0),
        ({"fault": [{"kind": "drawbar", "pull_n": 8000.0}]}, 0.0, 0.5),
    ],
    ids=["deep soil", "a soft hole", "uphill on ice", "an implement too many", "from the start"],
)
def test_a_tractor_that_spins_on_the_spot_is_stuck(overrides, least_x, most_x):
    log = ends(**overrides)
    assert log.outcome == log.metrics["outcome"] == "stuck"
    assert least_x < log.column("x")[-1] < most_x
    last = log.column("t") > log.column("t")[-1] - STUCK_S
    assert np.ptp(log.column("x")[last]) < 0.7
    assert log.column("pedal")[last].min() > 0.9 * STUCK_PEDAL
    assert log.metrics["physics_warnings"] == 0


@pytest.mark.parametrize(
    "overrides",
    [
        {"path__speed_m_s": 0.1},
        {"path__speed_m_s": 0.05, "path__ramp_s": 20.0},
        {"path__ramp_s": 60.0},
        {"path__speed_m_s": 0.001, "controller": {"kind": "open_loop"}},
        {"fault": [{"kind": "drawbar", "pull_n": 2500.0}]},
        {"plant": {"tyre": {"kind": "soil", "cone_index_kpa": 120.0}}},
    ],
    ids=["0.1 m/s", "0.05 m/s", "slow start", "pedal released", "implement", "soft soil"],
)
def test_a_slow_a_waiting_and_a_toiling_tractor_are_not_stuck(overrides):
    assert ends(25.0, **overrides).outcome == "completed"


def watched(truths):
    """Outcomes that a watch of a sound plant sees, tick by tick."""
    plant = SimpleNamespace(trouble=lambda: None)
    watch = Watch(plant)
    return [watch.trouble(truth, 0.0) for truth in truths]


def still(pedal, x=0.0):
    return SimpleNamespace(x=x, y=0.0, pedal=pedal)


def test_it_is_stuck_after_ten_seconds_of_trying_and_not_before():
    seen = watched([still(0.3)] * 300)
    assert seen.index("stuck") == pytest.approx(STUCK_S / TICK_S, abs=1)


def test_backwards_it_can_be_stuck_too():
    assert watched([still(-0.3)] * 300)[-1] == "stuck"


def test_the_time_begins_anew_when_it_gets_away_or_lets_go_of_the_pedal():
    held = [still(0.3)] * 190
    assert set(watched([*held, still(0.3, x=0.4), *[still(0.3, x=0.4)] * 190])) == {None}
    assert set(watched([*held, still(0.0), *held])) == {None}
    assert set(watched([still(0.04)] * 1000)) == {None}


# --- the others ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settle_s", [0.0, 3.0])
def test_a_slope_of_37_degrees_turns_it_over(settle_s):
    """Also while it is put there: then the run has one row."""
    log = ends(20.0, terrain={"kind": "slope", "grade_deg": 37.0, "direction_deg": 90.0}, plant={"settle_s": settle_s})
    assert log.outcome == "rolled_over"
    assert log.column("t")[-1] < 10
    assert (log.signals.num_rows == 1) == (settle_s > 0)
    assert abs(log.column("y")[-1]) < 3


@pytest.mark.parametrize(("height", "outcome"), [(0.0, None), (0.3, "rolled_over")])
def test_a_bump_below_the_upper_wheels_turns_it_over_on_a_slope_that_it_can_stand_on(height, outcome):
    nodes = 0.1 * np.arange(-150, 151)
    x, y = np.meshgrid(nodes, nodes)
    bump = height * np.exp(-(((x - 4.0) / 0.4) ** 2)) * (y > 0.1)
    ground = Ground(-15.0, -15.0, 0.1, np.tan(np.radians(26)) * y + bump)
    plant = MujocoPlant(Mujoco(), Machine(), ground)
    driver = Driver(plant, plant.reset(Reference(0, 0, 0, 0, 0, 0)), 2.5)  # at 2 m/s it is held at the foot of the bump
    for _ in range(200):
        if plant.trouble() is not None or driver.truth.x > 7.0:
            break
        driver.go(TICK_S, lambda truth: 0.25 - 1.5 * truth.yaw)
    assert plant.trouble() == outcome
    assert driver.truth.x > 2.5
    assert plant.warnings() == 0


def test_it_has_diverged_when_it_is_nowhere_near_its_reference():
    plant, truth = SimpleNamespace(trouble=lambda: None), still(0.0)
    watch = Watch(plant)
    assert watch.trouble(truth, LOST_M - 1e-6) is None
    assert watch.trouble(truth, LOST_M) == "diverged"
    assert watch.trouble(truth, float("nan")) == "diverged"


def test_a_payload_that_is_dropped_and_a_wind_that_ends_end_no_run():
    faults = [
        {"kind": "payload", "mass_kg": 250.0, "left_m": 0.2, "end_s": 5.0},
        {"kind": "payload", "mass_kg": -30.0, "ahead_m": 1.3, "start_s": 3.0},
        {"kind": "side_force", "force_n": 800.0, "gust_share": 0.3, "start_s": 2.0, "end_s": 6.0},
        {"kind": "drawbar", "noise_share": 0.3, "start_s": 4.0},
        {"kind": "soft_tyre", "wheel": "fr", "start_s": 1.0},
        {"kind": "soft_tyre", "wheel": "rl", "start_s": 7.0},
    ]
    log = ends(10.0, fault=faults)
    assert log.outcome == "completed"
    assert log.metrics["physics_warnings"] == 0
    loads = sum(log.column(f"load_{wheel}") for wheel in ("fl", "fr", "rl", "rr"))
    for t, mass in ((2.9, 1000.0), (4.8, 970.0), (9.5, 720.0)):
        near = np.abs(log.column("t") - t) < 0.25
        assert loads[near].mean() == pytest.approx(mass * 9.81, rel=0.03)
