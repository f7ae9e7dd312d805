"""Limit search with known success rates, and the grammar of failure conditions."""

import json
from functools import partial
from math import exp, inf

import numpy as np
import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.search.limit import question
from agrobot_mj.extensions.search.limit.condition import Condition
from agrobot_mj.extensions.search.limit.interval import runs_needed, sequential_interval
from agrobot_mj.extensions.search.limit.question import Question, as_value, check, condition_of, metric_names
from agrobot_mj.extensions.search.limit.search import SHOWN_RUNS, find_limit
from agrobot_mj.studies.engine.tasks import failure
from agrobot_mj.studies.statistics import wilson_interval

KEY = "steering.valve.dead_band_v"
METRICS = ("lateral_rms", "xte_rms", "passes.xte_mean")
SCENARIO = load_scenario("figure_eight", {"plant.kind": "bicycle", "duration_s": 1.0})


# --- the condition ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "met"),
    [
        ("lateral_rms > 0.3", False),
        ("lateral_rms >= .25 and outcome == completed", True),
        ("outcome != completed or xte_rms < 0.1", True),
        ("not (outcome != 'completed' or lateral_rms > 0.3)", True),
        ("0.2 < lateral_rms < 0.3", True),
        ("xte_rms > lateral_rms", False),
        ("completed != outcome", False),
        ("passes.xte_mean < -0.5", True),
        ("outcome == rolled_over", False),
    ],
)
def test_failure_conditions_combine_comparisons_and_boolean_operators(text, met):
    numbers = {"outcome": "completed", "lateral_rms": 0.25, "xte_rms": 0.05, "passes.xte_mean": -1.0}
    assert Condition(text, METRICS).is_met(numbers) is met


@pytest.mark.parametrize("text", ["lateral_rms > 0.3", "not lateral_rms < 0.3", "outcome == stuck or lateral_rms < 1"])
def test_missing_metric_value_counts_as_failure(text):
    assert Condition(text, METRICS).is_met({"outcome": "completed", "lateral_rms": None})


UNREADABLE = ("", "lateral_rms", "1 < 2", "lateral_rms >", "lateral_rms + 1 > 2", "lateral_rms > 'a'", "outcome > 3")
UNREADABLE += ("outcome < completed", "outcome == lateral_rms", "lateral_rms in (1, 2)", "lateral_rms is None")
UNREADABLE += ("lateral_rms > True", "__import__('os').system('touch hacked') == 0", "lateral_rms.__class__ == 0")
UNREADABLE += ("[lateral_rms > 1 for x in y]", "(lambda: lateral_rms > 1)()", "lateral_rms > (x := 3)")
UNREADABLE += ("lateral_rms > 9 ** 9 ** 9", "f'{lateral_rms}' == completed", "0.3and lateral_rms > 1")
UNREADABLE += ("lateral_rms > 1" + " or lateral_rms > 1" * 200, "(" * 300 + "lateral_rms > 1" + ")" * 300)
UNREADABLE += ("lateral_rms > 1\x00",)


@pytest.mark.parametrize("text", UNREADABLE)
def test_invalid_condition_is_rejected_with_an_example_and_not_executed(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ScenarioError, match="--until") as caught:
        Condition(text, METRICS)
    assert "lateral_rms > 0.3 or outcome != completed" in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_invalid_syntax_of_a_condition_is_rejected_without_a_run(monkeypatch):
    monkeypatch.setattr(question, "metric_names", lambda scenario: pytest.fail("a run was started"))
    with pytest.raises(ScenarioError, match="cannot be parsed"):
        condition_of("lateral_rms >", SCENARIO)


def test_error_for_an_unknown_metric_lists_the_available_metrics():
    with pytest.raises(ScenarioError, match="no metric 'latral_rms'; did you mean 'lateral_rms'") as caught:
        Condition("latral_rms > 1", metric_names(SCENARIO))
    assert "xte_abs_p95" in str(caught.value)


# --- the statistics -----------------------------------------------------------------------------------------------


def test_success_rate_interval_equals_the_wilson_interval():
    """Newcombe (1998), Statistics in Medicine 17, table I, score method without correction: 81 of 263 at 95 %."""
    assert wilson_interval(81, 263, 0.95) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson_interval(0, 20, 0.95) == pytest.approx((0.0, 0.1611), abs=5e-5)


@pytest.mark.parametrize(("reliability", "confidence"), [(0.8, 0.8), (0.9, 0.8), (0.5, 0.95), (0.01, 0.1)])
def test_required_number_of_runs_is_the_minimum_sufficient_number(reliability, confidence):
    n = runs_needed(reliability, confidence)
    assert sequential_interval(n, n, confidence)[0] >= reliability
    assert n == 1 or sequential_interval(n - 1, n - 1, confidence)[0] < reliability


RELIABILITIES = (0.7, 0.75, 0.8, 0.85, 0.9)
LONG = [pytest.param(26, each, marks=() if each == 0.8 else pytest.mark.slow) for each in RELIABILITIES]


@pytest.mark.parametrize(("seeds", "reliability"), [*((SHOWN_RUNS, each) for each in RELIABILITIES), *LONG])
def test_results_reported_as_certain_are_wrong_no_more_often_than_stated(reliability, seeds):
    """The reliability is the same at all of 500 values; at 80 %, the permitted error rate is 10 %."""
    wrong = values = 0
    question = Question(KEY, 0.0, 4.0, "lateral_rms > 0.3", seeds=seeds, tolerance=9.0)
    condition = Condition(question.until, METRICS)
    for first in range(100):
        scenario = SCENARIO.changed({"seed": 1000 * first})
        found = find_limit("law", scenario, question, condition, machine(lambda v: reliability), lambda tried: None)
        values += len(found.tried)
        wrong += sum(t.certain and t.holds != (reliability >= 0.8) for t in found.tried)
    assert values == 500
    assert wrong / values <= (0.1 if reliability == 0.8 else 0.05 if reliability in (0.75, 0.85) else 0.03)


@pytest.mark.parametrize(
    ("key", "value", "taken"),
    [
        (KEY, 0.1 + 0.2, 0.3),
        ("sensors.gnss.latency_s", 0.1234, 0.1),
        ("sensors.gnss.rate_hz", 12.5, 10.0),
        ("sensors.gnss.rate_hz", 6.1, 6.666666667),
        ("sensors.steering_pot.samples", 43.6, 44),
    ],
)
def test_evaluated_values_have_the_type_of_the_key(key, value, taken):
    found = as_value(SCENARIO, key, value)
    assert (found, isinstance(found, int)) == (taken, key.endswith("samples"))
    SCENARIO.changed({key: taken})


@pytest.mark.parametrize(
    ("key", "values"),
    [("sensors.gnss.rate_hz", (0.0, -5.0, 1e-320, 40.0)), ("sensors.gnss.latency_s", (-0.01, 1e308, inf))],
)
def test_values_beyond_the_limits_of_a_key_remain_invalid(key, values):
    for value in values:
        with pytest.raises(ScenarioError, match=key):
            SCENARIO.changed({key: as_value(SCENARIO, key, value)})


# --- the search ---------------------------------------------------------------------------------------------------


def machine(chance):
    """Return a function that simulates runs whose success probability depends on the value. Equal seeds repeat runs."""

    def do(tasks):
        found = []
        for task in tasks:
            value, seed = task.overrides[KEY], task.overrides["seed"]
            success = np.random.default_rng([seed, int(1e6 * abs(value))]).random() < chance(value)
            found.append({"outcome": "completed", "lateral_rms": (0.1 if success else 1.0) + 1e-6 * seed})
        return found

    return do


def search(chance, **more):
    question = Question(KEY, *more.pop("ends", (0.0, 4.0)), "lateral_rms > 0.3", **more)
    return find_limit(
        "law", SCENARIO, question, Condition(question.until, METRICS), machine(chance), lambda tried: None
    )


def test_abrupt_limit_is_found_within_the_tolerance():
    found = search(lambda v: v < 2.345, tolerance=0.01)
    assert found.verdict == "limit"
    assert found.limit == pytest.approx(2.345, abs=0.01)
    low, high = found.interval
    assert low < 2.345 <= high
    assert high - low <= 0.01
    assert "80 % of runs at 80 % confidence" in found.statement
    assert [t.value for t in found.tried] == sorted(t.value for t in found.tried)
    shown = {t.value: t.runs for t in found.tried if t.value in (low, high)}
    assert shown == {low: SHOWN_RUNS, high: SHOWN_RUNS}
    assert max(t.runs for t in found.tried if t.value not in shown) == runs_needed(0.8, 0.8) == SHOWN_RUNS


def test_limit_is_found_in_a_descending_range():
    found = search(lambda v: v > 2.345, ends=(4.0, 0.0), tolerance=0.01)
    assert found.limit == pytest.approx(2.345, abs=0.01)


@pytest.mark.parametrize("width", [0.08, 0.15, 0.6])
def test_interval_covers_the_limit_if_the_success_rate_falls_gradually(width):
    """The success rate falls along a logistic curve through 80 % at 2.1; runs differ with the first seed."""
    hits = []
    for first in range(60):
        scenario = SCENARIO.changed({"seed": 1 + 100 * first})
        question = Question(KEY, 0.0, 4.0, "lateral_rms > 0.3", seeds=24)
        condition = Condition(question.until, METRICS)
        chance = machine(lambda v: 1 / (1 + exp((v - 2.1) / width - 1.3863)))
        if interval := find_limit("law", scenario, question, condition, chance, lambda tried: None).interval:
            hits.append(interval[0] <= 2.1 <= interval[1])
    assert len(hits) > 50
    assert np.mean(hits) >= 0.88


@pytest.mark.parametrize(
    ("until", "numbers", "fails"),
    [
        ("xte_rms > 0.5", {"outcome": "rolled_over", "xte_rms": 0.1}, True),
        ("steer_share > 0.5", {"outcome": "stopped", "steer_share": 0.0}, True),
        (
            "steer_share > 0.5",
            {"outcome": "stopped", "expected": True, "steer_share": 0.0},
            False,
        ),
        (
            "steer_share > 0.5",
            {"outcome": "completed", "expected": False, "steer_share": 0},
            True,
        ),
        ("outcome == diverged", {"outcome": "stopped"}, False),
        ("xte_rms > 0.5 or outcome == diverged", {"outcome": "rolled_over", "xte_rms": 0.1}, True),
        ("xte_rms > 0.5", {"outcome": "completed", "xte_rms": 0.1}, False),
        ("xte_rms > 0.5", {"outcome": "error"}, True),
        ("outcome != error", {"outcome": "error"}, True),
    ],
)
def test_unexpected_outcome_is_a_failure_unless_condition_names_outcomes(until, numbers, fails):
    assert Condition(until, {*METRICS, "steer_share"}).fails(numbers) is fails


def test_limit_result_reports_unexpected_outcomes():
    """From the value 2 on, every run rolls over with a small error."""

    def do(tasks):
        rolled = [task.overrides[KEY] >= 2.0 for task in tasks]
        errors = [0.1 + 1e-6 * task.overrides["seed"] for task in tasks]
        ends = zip(rolled, errors, strict=True)
        return [{"outcome": "rolled_over" if r else "completed", "lateral_rms": e} for r, e in ends]

    question = Question(KEY, 0.0, 4.0, "lateral_rms > 0.3", tolerance=0.5)
    told = []
    found = find_limit("law", SCENARIO, question, Condition(question.until, METRICS), do, told.append)
    assert found.verdict == "limit"
    assert 1.0 < found.limit <= 2.0
    assert (
        "Some runs did not end as expected: 12 rolled_over at 2; 2 rolled_over at 3; 2 rolled_over at 4"
        in found.statement
    )
    assert {t.ends for t in told if t.unexpected} == {"2 rolled_over", "12 rolled_over"}


def test_limit_search_rejects_an_error_condition_if_failure_is_expected():
    scenario = load_scenario("rollover", {"duration_s": 1.0})
    for until, refused in (("xte_rms > 0.5", True), ("xte_rms > 0.5 or outcome != completed", False)):
        question = Question("terrain.grade_deg", 5.0, 35.0, until)
        if refused:
            with pytest.raises(
                ScenarioError, match=r"rollover expects rolled_over; add --set expected_outcome=completed"
            ):
                check(question, {"law": scenario})
        else:
            check(question, {"law": scenario})


def test_law_that_always_or_never_fails_is_reported():
    assert search(lambda v: 1.0).verdict == "never_fails"
    assert search(lambda v: 0.0).verdict == "always_fails"
    assert search(lambda v: v > 3.0).verdict == "fails_at_start"
    assert all(search(lambda v, p=p: p).limit is None for p in (0.0, 1.0))


def test_law_that_succeeds_again_above_its_limit_is_reported():
    found = search(lambda v: not 0.9 < v < 1.2)
    assert found.verdict == "not_monotone"
    assert found.limit == pytest.approx(0.9, abs=0.08)
    assert "succeeds again at 2, 3, 4" in found.statement


def test_random_variation_of_the_success_rate_is_not_reported_as_a_limit():
    found = search(lambda v: 0.75 if v > 1.0 else 1.0)
    assert found.verdict == "limit"
    found = search(lambda v: 0.75)
    assert found.verdict != "not_monotone"


def test_result_from_too_few_seeds_is_not_reported_as_certain():
    found = search(lambda v: v < 2.345, seeds=3)
    assert found.limit == pytest.approx(2.345, abs=0.08)
    assert "Intermediate values are classified by 3 runs each; the confidence needs 12" in found.statement
    assert [t.runs for t in found.tried if t.certain and t.holds] == [SHOWN_RUNS]


def test_values_on_both_sides_of_the_limit_are_checked_by_more_runs():
    """Between 1.5 and 2.345, one third of the runs fails, which twelve runs detect, but three may not."""
    for first in range(1, 60, 10):
        scenario = SCENARIO.changed({"seed": first})
        question = Question(KEY, 0.0, 4.0, "lateral_rms > 0.3", seeds=3)
        chance = machine(lambda v: 1.0 if v < 1.5 else 0.67 if v < 2.345 else 0.0)
        condition = Condition(question.until, METRICS)
        found = find_limit("law", scenario, question, condition, chance, lambda tried: None)
        k = next(k for k, t in enumerate(found.tried) if not t.holds)
        good, bad = found.tried[k - 1 : k + 1]
        assert good.runs == bad.runs == SHOWN_RUNS
        assert good.share in found.statement
        assert bad.share in found.statement
        assert good.failed / good.runs <= 0.2 < bad.failed / bad.runs


def test_end_of_a_range_without_failure_is_checked_by_more_runs():
    found = search(lambda v: 1.0, seeds=3)
    assert found.verdict == "never_fails"
    assert [t.runs for t in found.tried] == [3, 3, 3, 3, SHOWN_RUNS]
    assert f"12 of 12 runs at {found.tried[-1].value:g}" in found.statement


def test_limit_result_states_evaluated_values_and_gaps_between_them():
    found = search(lambda v: not 1.1 < v < 1.9)  # an island between two values of the scan
    assert found.verdict == "never_fails"
    assert (
        "Succeeded at 0, 1, 2, 3, 4; no value in between was evaluated; an interval of up to 1 with another result"
        in (found.statement)
    )
    assert "does not fail at evaluated values" in found.statement
    found = search(lambda v: v < 2.345, tolerance=0.5)
    assert "Succeeded at 0, 1, 2; failed at 2.5, 3, 4; no value in between was evaluated" in found.statement


def test_identical_runs_of_all_seeds_count_once_and_give_no_interval():
    def do(tasks):
        errors = [0.1 if task.overrides[KEY] < 2.345 else 1.0 for task in tasks]
        return [{"outcome": "completed", "lateral_rms": e, "wall_s": 1.0 + k} for k, e in enumerate(errors)]

    question = Question(KEY, 0.0, 4.0, "lateral_rms > 0.3")
    found = find_limit("law", SCENARIO, question, Condition(question.until, METRICS), do, lambda tried: None)
    assert found.limit == pytest.approx(2.345, abs=0.08)
    assert {(t.runs, t.independent, t.certain) for t in found.tried} == {(1, False, True)}
    assert all(t.low == t.high == 1 - t.failed for t in found.tried)
    assert "Seeds have no effect: one run gives the result, without an interval" in found.statement
    random = search(lambda v: v < 2.345)
    assert all(t.independent for t in random.tried)
    assert "Seeds have no effect" not in random.statement


def hard_and_sound(limits):
    """Return a function that simulates runs whose limit along KEY depends on their terrain."""

    def do(tasks):
        found = []
        for task in tasks:
            kind = json.loads(task.base).get("terrain", {}).get("kind", "flat")
            value = task.overrides.get(KEY, 0.0)
            error = (0.1 if value < limits[kind] else 1.0) + 1e-6 * task.overrides["seed"]
            found.append({"outcome": "completed", "lateral_rms": error})
        return found

    return do


@pytest.mark.parametrize(
    ("limits", "text"),
    [
        ({"flat": 3.0, "rough": 2.0}, "; the disturbance reduces the limit by 1"),
        ({"flat": 2.0, "rough": 2.0}, "; the disturbance reduces the limit by less than the resolution of 0.08"),
        ({"flat": 9.0, "rough": 2.0}, "; not comparable: one limit is out of range"),
    ],
)
def test_limit_is_reported_with_the_limit_of_the_baseline(limits, text):
    scenario = load_scenario("figure_eight", {"terrain": {"kind": "rough"}, "duration_s": 1.0})
    question = Question(KEY, 0.0, 4.0, "lateral_rms > 0.3")
    condition, beside = Condition(question.until, METRICS), {"terrain": {"kind": "flat"}}
    found = find_limit("law", scenario, question, condition, hard_and_sound(limits), lambda tried: None, beside)
    assert found.limit == pytest.approx(2.0, abs=0.08)
    assert found.beside.verdict == ("never_fails" if limits["flat"] > 4 else "limit")
    assert found.beside.statement.endswith(text)


def test_baseline_that_lacks_the_varied_key_has_one_fixed_result():
    """Flat terrain has no grade, and a dead band set by the baseline is not varied in it."""
    scenario = load_scenario("figure_eight", {"terrain": {"kind": "slope"}, "duration_s": 1.0})
    for key, beside in (("terrain.grade_deg", {"terrain": {"kind": "flat"}}), (KEY, {KEY: 0.4})):
        question = Question(key, 0.0, 4.0, "lateral_rms > 0.3")
        do = hard_and_sound({"flat": 9.0, "slope": 9.0})
        found = find_limit("law", scenario, question, Condition(question.until, METRICS), do, lambda t: None, beside)
        assert found.beside.verdict == "fixed"
        assert found.beside.limit is None
        assert found.beside.tried[0].runs == SHOWN_RUNS
        assert "12 of 12 runs succeed, median lateral_rms 0.1" in found.beside.statement


def test_run_that_raises_an_error_counts_as_failed_for_any_condition():
    question = Question(KEY, 0.0, 4.0, "outcome == stuck")
    condition = Condition(question.until, METRICS)
    found = find_limit(
        "law", SCENARIO, question, condition, lambda tasks: [failure("x").row for _ in tasks], lambda t: None
    )
    assert found.verdict == "always_fails"
    assert found.tried[0].outcomes == {"error": found.tried[0].runs}


def test_limit_search_of_an_integer_key_evaluates_integers():
    scenario = load_scenario("figure_eight")
    question = Question("path.turns", 1.0, 9.0, "lateral_rms > 0.3")
    seen = []

    def do(tasks):
        seen.extend(task.overrides["path.turns"] for task in tasks)
        error = 0.1 if seen[-1] < 4 else 1.0
        return [{"outcome": "completed", "lateral_rms": error + 1e-6 * task.overrides["seed"]} for task in tasks]

    found = find_limit("law", scenario, question, Condition(question.until, METRICS), do, lambda tried: None)
    assert all(type(value) is int for value in seen)
    assert found.interval == (3, 4)


@pytest.mark.parametrize(
    "change", [{"stop": 0.0}, {"tolerance": 0.0}, {"reliability": 1.0}, {"confidence": 0.0}, {"key": "steering.x"}]
)
def test_invalid_limit_search_settings_are_rejected(change):
    question = Question(KEY, 0.0, 1.0, "lateral_rms > 0.3")._replace(**change)
    with pytest.raises(ScenarioError):
        check(question, {"law": SCENARIO})


# --- the command --------------------------------------------------------------------------------------------------


@pytest.fixture
def call(call):
    """Return a function that runs `agrobot-mj limit` in an empty folder and returns exit status, stdout and stderr."""
    return partial(call, "limit")


SHORT = ("--set", "plant.kind=bicycle", "--set", "duration_s=4", "--jobs", 1, "--out", "out")


def test_limit_command_compares_laws_and_writes_its_result(call, tmp_path):
    """Both laws follow a circle of 6 m radius within 20 mm, but not a circle of 2 m radius."""
    where = ("--key", "path.radius_m", "--range", "6:2", "--tolerance", 0.5)
    options = (*where, "--guidance", "stanley,lqr", "--max-seeds", 3, "--beside", "path.radius_m=6")
    status, out, err = call("circle", *options, "--until", "xte_rms > 0.02", *SHORT)
    assert (status, err) == (0, "")
    content = json.loads((tmp_path / "out" / "limit.json").read_text())
    assert [law["law"] for law in content["laws"]] == ["stanley", "lqr"]
    for law in content["laws"]:
        assert law["verdict"] == "limit"
        assert 6 >= law["interval"][0] > law["limit"] > law["interval"][1] >= 2
        assert law["statement"] in out
        assert law["beside"]["statement"].startswith("with path.radius_m=6: ")
        assert "of 12 runs succeed, median xte_rms 0.0" in law["beside"]["statement"]
        assert law["beside"]["statement"] in out
    assert (tmp_path / "out" / "limit.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("option", "value", "text"),
    [
        ("--range", "1-8", "--range 1-8: specify two numbers, such as 0:25"),
        ("--until", "os.system('x') > 1", "specify comparisons of metrics and outcome"),
        ("--beside", "terain.kind=flat", "unknown key"),
        ("--beside", "flat", "--beside flat: the override must have the form key=value"),
        ("--key", "path.sped_m_s", "did you mean 'speed_m_s'"),
        (
            "--key",
            "seed",
            "--key seed: the seed is not a parameter to search; every value is run with up to --max-seeds seeds",
        ),
        ("--guidance", "lqqr", "unknown kind 'lqqr'"),
        ("--range", "1:-8", "path.speed_m_s: must be at least"),
    ],
)
def test_invalid_limit_arguments_are_reported_before_any_run(call, option, value, text, tmp_path):
    options = {"--key": "path.speed_m_s", "--range": "1:5", "--until": "longitudinal_rms > 1", option: value}
    status, out, err = call("straight_line", *[part for pair in options.items() for part in pair], *SHORT)
    assert (status, out) == (2, "")
    assert text in err
    assert not (tmp_path / "out").exists()
