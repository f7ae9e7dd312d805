"""Continuation of a run with another scenario, as if this scenario had been simulated from the start."""

import pytest

from agrobot_mj import Simulation
from agrobot_mj.core.errors import CommandError
from agrobot_mj.extensions.play.continuing import continue_run
from agrobot_mj.simulation.run import run

SCENARIO = {"plant.kind": "bicycle", "duration_s": 6.0}
JUMP = {"kind": "gnss_jump", "start_s": 2.05, "north_m": 0.5}
FLOAT = {"kind": "gnss_float", "start_s": 2.05}


@pytest.fixture
def sim():
    """Return a simulation of a circle after two seconds."""
    found = Simulation("circle", SCENARIO | {"fault": [{"kind": "gnss_latency", "start_s": 0.5, "end_s": 4.0}]})
    found.reset()
    for _ in range(40):
        found.step()
    return found


def with_faults(sim, *more, **first):
    """Return the scenario of a simulation with a changed first fault and additional faults."""
    own = sim.scenario.fault[0].model_dump(mode="json", exclude_none=True)
    return sim.scenario.changed({"fault": [{**own, **first}, *more]})


def to_the_end(sim):
    while not sim.done:
        sim.step()
    return sim.log().signals


def test_faults_added_during_a_run_act_as_if_known_from_the_start(sim):
    scenario = with_faults(sim, JUMP, FLOAT)
    assert to_the_end(continue_run(sim.save(), scenario)).equals(run(scenario).signals)


def test_run_with_the_contact_tyre_continues_without_a_warning(recwarn):
    keys = {"plant.tyre.kind": "contact", "plant.settle_s": 0.1, "duration_s": 0.5}
    sim = Simulation("straight_line", keys)
    sim.reset()
    sim.step()
    scenario = sim.scenario.changed({"fault": [{**JUMP, "start_s": 0.3}]})
    recwarn.clear()
    assert to_the_end(continue_run(sim.save(), scenario)).equals(run(scenario).signals)
    assert not [each for each in recwarn if each.category is RuntimeWarning]


def test_active_fault_may_end_earlier_or_later(sim):
    for end in (2.05, 3.0, 5.0):
        scenario = with_faults(sim, end_s=end)
        assert to_the_end(continue_run(sim.save(), scenario)).equals(run(scenario).signals)


def test_future_fault_may_be_removed_or_replaced(sim):
    planned = continue_run(sim.save(), with_faults(sim, {**JUMP, "start_s": 5.0}))
    scenario = with_faults(sim, FLOAT)
    assert to_the_end(continue_run(planned.save(), scenario)).equals(run(scenario).signals)


def test_duration_of_a_continued_run_may_be_reduced(sim):
    scenario = sim.scenario.changed({"duration_s": 3.0})
    signals = to_the_end(continue_run(sim.save(), scenario))
    assert signals.num_rows == 60
    assert signals.equals(run(scenario).signals)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"seed": 5}, "seed must not change"),
        ({"path.radius_m": 12.0}, "path must not change"),
        ({"guidance.kind": "lqr"}, "guidance.kind must not change"),
        ({"duration_s": 1.0}, "must be at least the current time, 2 s"),
        ({"fault": []}, r"fault\[0\]: the change must not affect the time before"),
    ],
)
def test_change_of_faults_before_the_present_tick_is_rejected(sim, keys, message):
    with pytest.raises(CommandError, match=message):
        continue_run(sim.save(), sim.scenario.changed(keys))


def test_new_fault_that_starts_before_the_next_tick_is_rejected(sim):
    with pytest.raises(CommandError, match=r"fault\[1\]: the change must not affect the time before"):
        continue_run(sim.save(), with_faults(sim, {**JUMP, "start_s": 2.0}))
    with pytest.raises(CommandError, match=r"fault\[0\]: the change must not affect the time before"):
        continue_run(sim.save(), with_faults(sim, end_s=1.5))
