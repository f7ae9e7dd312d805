"""The search of gains: same budget for every law, judged on other cases, repeatable."""

import json

import pytest

from agrobot_mj.control import Guidance
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.spec import every
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.studies import tune as study
from agrobot_mj.studies.pieces import pieces
from agrobot_mj.studies.tune import (
    FAILED,
    MOST,
    POPULATION,
    Judgement,
    judge,
    tunable,
    tune,
    tuning_cases,
    write_tuning,
)

SHORT = {"plant.kind": "bicycle", "duration_s": 6.0, "path.kind": "lane_change"}


@pytest.mark.parametrize("kind", [kind for kind in every(Guidance) if not kind().outside])
def test_every_law_declares_what_can_be_tuned_within_its_limits(kind) -> None:
    scenario = load_scenario("figure_eight", {"guidance.kind": kind().kind, "controller.kind": "pi"})
    for key, (low, high) in tunable(scenario).items():
        assert low < high
        for value in (low, high):
            scenario.changed({key: value})


def test_a_law_without_ranges_is_named() -> None:
    scenario = load_scenario("figure_eight", {"controller.kind": "open_loop"})
    with pytest.raises(ScenarioError, match="kinematic"):
        tunable(scenario)


def test_training_and_test_share_neither_seeds_nor_surfaces() -> None:
    scenario = load_scenario("figure_eight")
    training, test = (tuning_cases(scenario, part, 2) for part in ("training", "test"))
    assert not {case.surface for case in training} & {case.surface for case in test}
    assert not {case.seed for case in training} & {case.seed for case in test}
    assert len(training) == 3 * 2 * 2
    assert len(test) == 3 * 1 * 2


def test_the_bicycle_leaves_out_what_it_does_not_have() -> None:
    bicycle = load_scenario("figure_eight", {"plant.kind": "bicycle"})
    assert {case.surface for case in tuning_cases(bicycle, "training", 1)} >= {"as the scenario", "worn valve"}
    assert not {case.surface for case in tuning_cases(bicycle, "test", 1)} & {"rough D", "side slope 10 deg"}


def cost(scenario, gains) -> float:
    return judge(scenario, gains).cost


def test_a_run_that_fails_costs_more_than_any_that_succeeds_and_the_less_the_farther_it_came() -> None:
    keys = {"plant.kind": "bicycle", "duration_s": 6.0, "guidance.kind": "stanley"}
    scenario = load_scenario("lane_change", keys)
    early, late = (judge(scenario, {"supervisor.max_cross_track_m": limit}) for limit in (0.004, 0.02))
    assert {early.row["outcome"], late.row["outcome"]} == {"stopped"}
    assert FAILED > MOST > cost(scenario, {})
    assert early.cost > late.cost > FAILED


def test_every_speed_covers_the_same_piece_of_the_path() -> None:
    for scenario in (load_scenario("lane_change", {"duration_s": 9.0}), load_scenario("lane_change")):
        cases = tuning_cases(scenario, "training", 1) + tuning_cases(scenario, "test", 1)
        assert len({case.speed for case in cases}) == 3
        assert set(pieces(case.scenario for case in cases)) == {1}


def test_a_scenario_that_expects_no_error_is_refused() -> None:
    scenario = load_scenario("figure_eight", SHORT | {"guidance.kind": "stanley", "expected_outcome": "stuck"})
    with pytest.raises(ScenarioError, match="add --set expected_outcome=completed"):
        tune(scenario)


def test_the_search_never_ends_worse_than_it_began(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """On a cheap stand-in for the runs with its optimum at twice the default gain."""
    calls: list[float] = []

    def stand_in(scenario, gains) -> Judgement:
        gain = scenario.changed(gains).guidance.gain_per_s
        calls.append(gain)
        return Judgement(abs(gain - 1.0), {"outcome": "completed"})

    monkeypatch.setattr(study, "judge", stand_in)
    scenario = load_scenario("figure_eight", {"guidance.kind": "stanley"})
    found = tune(scenario, budget=3 * POPULATION, seeds=1)
    assert found.provenance["evaluations"] == 3 * POPULATION
    training = found.provenance["training"]
    assert training["score"]["mean"] <= training["score_of_defaults"]["mean"] == pytest.approx(0.5)
    assert found.gains["guidance.gain_per_s"] == pytest.approx(1.0, abs=0.35)
    assert found == tune(scenario, budget=3 * POPULATION, seeds=1)
    assert json.loads(write_tuning(found, tmp_path).read_text())["gains"] == found.gains


def test_a_real_run_costs_error_and_steering() -> None:
    scenario = load_scenario("figure_eight", SHORT | {"guidance.kind": "stanley"})
    assert 0 < cost(scenario, {}) < 2
    assert cost(scenario, {"guidance.gain_per_s": 0.2}) != cost(scenario, {})
