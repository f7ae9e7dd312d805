"""Gain search: same budget for every law, evaluation on other cases, and repeatability."""

from math import inf

import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.search import tune as study
from agrobot_mj.extensions.search.tune import (
    FAILED,
    MOST,
    POPULATION,
    Judgement,
    judge,
    mean_costs,
    search,
    task_of,
    tunable,
    tune,
)
from agrobot_mj.extensions.search.tuning_cases import TuningCase, read_tuning, tuning_cases
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.reference import families
from agrobot_mj.studies.engine.tasks import perform
from agrobot_mj.studies.pieces import pieces

SHORT = {"plant.kind": "bicycle", "duration_s": 6.0, "path.kind": "lane_change"}
SURFACES, GAINS = read_tuning("surfaces"), read_tuning("gains")


@pytest.mark.parametrize("kind", [kind for kind in families()["guidance"].values() if kind.tunable])
def test_ends_of_tunable_gain_ranges_are_valid_values(kind) -> None:
    scenario = load_scenario("figure_eight", {"guidance.kind": kind().kind, "controller.kind": "pi"})
    for key, (low, high) in tunable(scenario).items():
        assert low < high
        for value in (low, high):
            scenario.changed({key: value})


def test_error_for_a_law_without_tunable_gain_ranges_names_the_law() -> None:
    scenario = load_scenario("figure_eight", {"controller.kind": "open_loop"})
    with pytest.raises(ScenarioError, match="kinematic"):
        tunable(scenario)


def test_training_cases_have_other_seeds_and_surfaces_than_test_cases() -> None:
    scenario = load_scenario("figure_eight")
    training, test = (tuning_cases(scenario, SURFACES, part, 2) for part in ("training", "test"))
    assert not {case.name for case in training} & {case.name for case in test}
    assert not {case.seed for case in training} & {case.seed for case in test}
    assert len(training) == 3 * 2 * 2
    assert len(test) == 3 * 1 * 2
    other = scenario.changed({"seed": scenario.seed + 7})
    assert {case.seed for case in tuning_cases(other, SURFACES, "training", 2)} == {other.seed, other.seed + 1}
    assert tuning_cases(other, SURFACES, "test", 2) == test, "judged alike, whatever the search has seen"


def test_tuning_on_the_bicycle_skips_unsupported_cases() -> None:
    bicycle = load_scenario("figure_eight", {"plant.kind": "bicycle"})
    assert {case.name for case in tuning_cases(bicycle, SURFACES, "training", 1)} >= {"as the scenario", "worn valve"}
    assert not {case.name for case in tuning_cases(bicycle, SURFACES, "test", 1)} & {"rough D", "side slope 10 deg"}


def tuning(tmp_path, text):
    """Write a tuning file with one training case of the given text."""
    path = tmp_path / "mine.toml"
    path.write_text(f'[[training]]\nname = "one"\n{text}\n[[test]]\nname = "two"\n')
    return path


@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_misspelt_key_in_a_tuning_case_is_an_error_on_every_plant(tmp_path, plant):
    file = read_tuning(tuning(tmp_path, 'set = { "terrain.kindd" = "slope" }'))
    with pytest.raises(ScenarioError, match=r"terrain\.kindd"):
        tuning_cases(load_scenario("figure_eight", {"plant.kind": plant}), file, "training", 1)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('measure = "speed"', r"training\[0\].measure: must be one of"),
        ("speeds_m_s = []", r"training\[0\].speeds_m_s: must have at least 1"),
        ("seed = 3", r"training\[0\].seed: unknown key"),
    ],
)
def test_errors_in_a_tuning_file_are_reported(tmp_path, text, told):
    with pytest.raises(ScenarioError, match=told):
        read_tuning(tuning(tmp_path, text))


def test_error_for_an_unknown_tuning_name_lists_the_available_names():
    with pytest.raises(ScenarioError, match=r"unknown tuning 'gain'.*gains.*surfaces"):
        read_tuning("gain")


@pytest.mark.parametrize("part", ["training", "test"])
def test_shipped_tuning_cases_cover_typical_field_work(part):
    """Training and test cases each include speeds of 3.5 m/s and more, starts off the path, a worn valve and a
    slope."""
    cases = tuning_cases(load_scenario("figure_eight", GAINS.set), GAINS, part, 1)
    assert max(case.speed for case in cases) >= 3.5
    assert min(case.speed for case in cases) <= 0.8
    assert any(case.scenario.fault for case in cases)
    assert any(case.scenario.terrain.kind == "slope" for case in cases)
    assert sum(case.measure == "acquisition" for case in cases) >= 3


def driven(case, gains) -> Judgement:
    """Return the cost and metrics of a run with the given gains."""
    return judge(case, perform(task_of(case, gains)).row)


def cost(scenario, gains) -> float:
    return driven(tracking(scenario), gains).cost


def tracking(scenario) -> TuningCase:
    """Return a tracking case of a scenario."""
    return TuningCase("one", "tracking", scenario.seed, scenario)


def test_failed_run_costs_more_than_a_success_and_less_if_it_fails_later() -> None:
    keys = {"plant.kind": "bicycle", "duration_s": 6.0, "guidance.kind": "stanley"}
    scenario = load_scenario("lane_change", keys)
    early, late = (driven(tracking(scenario), {"supervisor.max_cross_track_m": limit}) for limit in (0.004, 0.02))
    assert {early.row["outcome"], late.row["outcome"]} == {"stopped"}
    assert FAILED > MOST > cost(scenario, {})
    assert early.cost > late.cost > FAILED


def test_tuning_runs_at_every_speed_cover_the_same_path_section() -> None:
    for scenario in (load_scenario("lane_change", {"duration_s": 9.0}), load_scenario("lane_change")):
        cases = tuning_cases(scenario, SURFACES, "training", 1) + tuning_cases(scenario, SURFACES, "test", 1)
        assert len({case.speed for case in cases}) == 3
        assert set(pieces(case.scenario for case in cases)) == {1}


def test_tuning_scenario_with_an_expected_failure_is_rejected(tmp_path) -> None:
    scenario = load_scenario("figure_eight", SHORT | {"guidance.kind": "stanley", "expected_outcome": "stuck"})
    with pytest.raises(ScenarioError, match="add --set expected_outcome=completed"):
        tune(scenario, SURFACES, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_gain_search_result_is_at_least_as_good_as_the_initial_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    """A simple cost function with its minimum at twice the default gain replaces the runs."""
    scenario = load_scenario("figure_eight", {"guidance.kind": "stanley"})

    def stand_in(tasks):
        gains = [task.overrides.get("guidance.gain_per_s", scenario.guidance.gain_per_s) for task in tasks]
        return [{"outcome": "completed", "gain": gain} for gain in gains]

    monkeypatch.setattr(study, "judge", lambda case, row: Judgement(abs(row["gain"] - 1.0), row))
    training, test = (tuning_cases(scenario, SURFACES, part, 1) for part in ("training", "test"))
    found = search(scenario, training, test, 3 * POPULATION, stand_in)
    assert found["evaluations"] == 3 * POPULATION
    training_score = found["training"]
    assert (
        training_score["score"]["mean"]
        <= training_score["score_before"]["mean"]
        == pytest.approx(abs(scenario.guidance.gain_per_s - 1.0))
    )
    assert found["gains"]["guidance.gain_per_s"] == pytest.approx(1.0, abs=0.35)
    (*_, name), *trace = found["trace"]
    assert (name, len(trace)) == ("cost", 3 * POPULATION)
    assert min(trace, key=lambda row: row[-1])[:-1] == list(found["gains"].values())
    assert found == search(scenario, training, test, 3 * POPULATION, stand_in)


def test_tuning_cost_of_a_simulated_run_depends_on_the_gains() -> None:
    scenario = load_scenario("figure_eight", SHORT | {"guidance.kind": "stanley"})
    assert 0 < cost(scenario, {}) < 2
    assert cost(scenario, {"guidance.gain_per_s": 0.2}) != cost(scenario, {})


def test_evaluation_of_gains_stops_once_they_are_certainly_worse(monkeypatch):
    asked = []
    monkeypatch.setattr(study, "judge", lambda case, row: Judgement(3.0, row))

    def do(tasks):
        asked.append(len(tasks))
        return [{} for _ in tasks]

    cases = tuning_cases(load_scenario("figure_eight"), SURFACES, "training", 1)
    bounded, whole = mean_costs(cases, [{}, {}], [1.6, inf], do)
    assert bounded > 1.6
    assert asked == [2, 2, 2, 2, 1, 1]
    assert whole == pytest.approx(3.0)


def acquisition(law, **changes) -> Judgement:
    line = {"plant.kind": "bicycle", "path.start_offset_m": 1.0, "supervisor.enabled": False, "duration_s": 25.0}
    scenario = load_scenario("straight_line", {**line, "guidance.kind": law})
    return driven(TuningCase("line", "acquisition", 1, scenario), changes)


def test_acquisition_cost_is_higher_if_the_law_keeps_an_offset():
    assert acquisition("lqr").cost < 2.0
    assert acquisition("lqr").cost < acquisition("lqr", **{"guidance.offset_m": 2.0}).cost


def test_cost_of_not_reaching_the_line_grows_with_distance():
    near, far = (acquisition("lqr", **{"duration_s": end}) for end in (5.0, 2.5))
    assert FAILED < near.cost < far.cost
    assert not near.row["expected"]
    assert "not within 0.2 m of its line" in near.row["stop_reason"]
