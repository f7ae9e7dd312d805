"""Shipped machines: library scenarios, and the figure eight under LQR."""

from math import tan

import pytest
from measured import machines

from agrobot_mj.core.resources import machine_files, scenario_files
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.run import run

SOME = (
    ("riding", "lane_change"),
    ("orchard", "bumps"),
    ("robot", "rough_track"),
    ("utility", "split_friction"),
    ("row_crop", "furrows_across"),
    ("row_crop", "lane_change"),
)
"""Short pairs of machine and scenario that are simulated by default."""


def ends_as_listed(machine, name):
    """Check that a scenario on a machine ends as its file or the list of exceptions in docs/machines.md states."""
    row, exception = machines.drive((machine, name)), machines.listed().get((machine, name))
    assert row.get("warnings", 0) == 0
    assert not row["expected"] if exception else row["expected"], row
    assert row["ends"] == (exception or row["ends"])


@pytest.mark.parametrize(("machine", "name"), SOME)
def test_selected_runs_complete_or_are_listed_exceptions(machine, name):
    ends_as_listed(machine, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", scenario_files())
@pytest.mark.parametrize("machine", sorted(machine_files()))
def test_every_machine_completes_every_scenario_or_is_a_listed_exception(machine, name):
    ends_as_listed(machine, name)


def test_listed_exceptions_name_machines_and_scenarios_with_a_reason():
    exceptions = machines.listed()
    assert {machine for machine, _ in exceptions} <= set(machine_files())
    assert {name for _, name in exceptions} == set(machines.WHY) <= set(scenario_files())


@pytest.mark.parametrize("machine", ["row_crop", "utility"])
def test_large_machines_complete_omega_turns_with_default_settings(machine):
    """Law and turn radius are the defaults of the machine."""
    field = {"machine": machine, "path.length_m": 30.0, "path.run_in_m": 10.0, "path.count": 3}
    log = run(load_scenario("one_hectare", {**field, "physics": "fast", "seed": 605}))
    assert log.outcome == "completed"
    assert log.metrics["xte_rms"] < 0.15


def eight(machine):
    """Return a level figure eight whose size relative to the turning circle of the machine is that in the paper.

    If the figure is smaller than in the paper, the speed is reduced so that the yaw rate does not increase.
    """
    scenario = load_scenario("figure_eight", {"machine": machine, "guidance.kind": "lqr", "path.turns": 1})
    tightest = scenario.tractor.wheelbase_m / tan(scenario.tractor.steer_limit)
    share = tightest / 1.4
    path = {
        "path.radius_m": 10 * share,
        "path.straight_m": 28 * share,
        "path.run_in_m": 14 * share,
        "path.speed_m_s": 1.2 * min(share, 1.0),
        "terrain.half_size_m": 50 + 60 * share,
    }
    return scenario.changed(path)


def tracks(machine, share=1.0):
    """Check that the machine follows the first fraction `share` of its figure eight."""
    scenario = eight(machine)
    log = run(scenario.changed({"duration_s": float(round(share * scenario.path.duration_s))}))
    assert log.outcome == "completed"
    assert log.metrics["xte_rms"] < 0.05


def test_lqr_keeps_the_largest_machine_on_the_first_half_of_figure_eight():
    tracks("row_crop", 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("machine", sorted(machine_files()))
def test_lqr_keeps_every_machine_on_its_figure_eight(machine):
    tracks(machine)


def test_machine_from_mass_and_wheelbase_follows_its_reference():
    given = {"tractor.mass_kg": 6000.0, "tractor.wheelbase_m": 2.8, "path.speed_m_s": 2.0, "path.length_m": 100.0}
    log = run(load_scenario("straight_line", given))
    late = log.column("t") > 10.0
    assert log.outcome == "completed"
    assert abs(log.column("e_longitudinal")[late]).max() < 0.5
    assert abs(log.column("e_lateral")[late]).max() < 0.5
