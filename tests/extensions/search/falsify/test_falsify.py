"""Falsification with known failures, especially a failure that needs two harmless changes together."""

import json
from math import hypot, sqrt

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.search.falsify import command
from agrobot_mj.extensions.search.falsify import search as search_module
from agrobot_mj.extensions.search.falsify.search import CONFIRMED, FalsifyQuestion, FalsifySearch, Varied
from agrobot_mj.extensions.search.limit.condition import Condition
from agrobot_mj.extensions.search.limit.question import Question
from agrobot_mj.extensions.search.limit.search import find_limit

A, B, C = "steering.valve.dead_band_v", "sensors.gnss.sigma_m", "tractor.mass_kg"
RANGES = {A: (0.2, 1.2), B: (0.0, 0.5), C: (700.0, 900.0)}
UNTIL = "xte_abs_max > 0.3"
CONDITION = Condition(UNTIL, ["xte_abs_max"])
SCENARIO = load_scenario("straight_line", {"plant.kind": "bicycle", "duration_s": 1.0})


def plant(error, noise=0.0, unlucky=0.0):
    """Return a function that simulates runs whose maximum error depends on the distances (a, b, c) from mild values.

    Noise depends on the seed. With the first seed, the error is larger by `unlucky`.
    """

    def do(tasks):
        found = []
        for task in tasks:
            values = [task.overrides.get(key, mild) for key, (mild, _) in RANGES.items()]
            at = [(v - mild) / (hard - mild) for v, (mild, hard) in zip(values, RANGES.values(), strict=True)]
            size = error(*at) + noise * np.random.default_rng(task.overrides["seed"]).standard_normal()
            size += unlucky * (task.overrides["seed"] == SCENARIO.seed)
            numbers = {"outcome": "completed", "error": None, "xte_abs_max": size}
            found.append({**numbers, "rises": [[1, size / 0.3 - 1]], "ticks": 20})
        return found

    return do


def search(error, keys=(A, B), noise=0.0, unlucky=0.0, done=lambda tried: None, **more):
    varied = tuple(Varied.in_range(key, *RANGES[key]) for key in keys)
    question = FalsifyQuestion(varied, UNTIL, **{"seeds": 1, "budget": 120, **more})
    return FalsifySearch(SCENARIO, question, CONDITION, plant(error, noise, unlucky), done).run()


def planted(a, b, c=0.0):
    """Return an error due to an interaction: a or b alone has little effect, and runs fail from a b = 0.25 on."""
    return 0.05 + 0.02 * (a + b) + 0.23 * max(a * b, 0.0) / 0.25


def test_failure_of_combined_keys_is_found_if_each_key_alone_passes():
    found = search(planted)
    assert found.verdict == "falsified"
    assert found.mildest.failed == found.mildest.runs == CONFIRMED
    assert found.mildest.distances == pytest.approx((0.5, 0.5), abs=0.08)
    assert found.mildest.distance == pytest.approx(sqrt(0.5), rel=0.03)
    assert "It succeeds with only steering.valve.dead_band_v = 1.2, sensors.gnss.sigma_m = 0.5" in found.statement
    for key in (A, B):
        question = Question(key, *RANGES[key], UNTIL)
        along = find_limit("law", SCENARIO, question, CONDITION, plant(planted), lambda tried: None)
        assert along.verdict == "never_fails"


@pytest.mark.parametrize(
    ("error", "place"),
    [
        (lambda a, b, c: a + 0.2 * b - 0.5, (0.769, 0.154, 0.0)),
        (lambda a, b, c: 0.3 * (a + b + c) / 1.2, (0.4, 0.4, 0.4)),
        (lambda a, b, c: 0.5 - hypot(a - 0.8, b - 0.6, c), (0.64, 0.48, 0.0)),
    ],
    ids=["one key matters most", "all alike", "an island"],
)
def test_smallest_failing_combination_of_three_keys_is_found(error, place):
    found = search(error, (A, B, C), budget=250)
    assert found.mildest.distance == pytest.approx(hypot(*place), rel=0.04)
    assert found.mildest.fails


def test_legend_does_not_overlap_the_plotted_combinations():
    found, varied = search(planted), tuple(Varied.in_range(key, *RANGES[key]) for key in (A, B))
    figure = command.figure(FalsifyQuestion(varied, UNTIL), found, [])
    assert all(axes.get_legend() is None for axes in figure.axes)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["holds", "fails", "answer"]


def test_values_next_to_the_found_failure_show_the_failure_boundary():
    """Runs with smaller changes on the line to the failure pass, and runs beyond the failure fail."""
    nearer, near, farther, far, less_a, more_a, less_b, more_b = search(planted).around
    assert [tried.fails for tried in (nearer, near, farther, far)] == [False, False, True, True]
    assert [tried.fails for tried in (less_a, more_a, less_b, more_b)] == [False, True, False, True]
    assert all(tried.runs == CONFIRMED for tried in (nearer, far, less_b))


def test_progress_callback_receives_all_evaluations_and_confirmations():
    """Evaluations of the search have one run each; confirmations have more."""
    told = []
    found = search(planted, done=told.append)
    assert [tried for tried in told if tried.runs == 1] == list(found.tried)
    assert told[-len(found.around) :] == list(found.around)
    assert found.mildest in told


def test_noisy_combination_is_classified_by_the_majority_of_its_runs():
    found = search(planted, noise=0.03, seeds=3)
    assert found.mildest.distance == pytest.approx(sqrt(0.5), rel=0.1)
    assert all(tried.runs == 3 for tried in found.tried)


def test_failure_with_only_one_seed_is_not_reported_as_the_result():
    """With the seed of the search, runs fail from a = 0.3 on; with all other seeds, from a = 0.8 on."""
    found = search(lambda a, b, c: 0.3 + a - 0.8, unlucky=0.5)
    assert min(tried.distance for tried in found.tried if tried.fails) < 0.35
    assert found.mildest.distances[0] == pytest.approx(0.8, abs=0.02)
    assert found.mildest.failed == found.mildest.runs == CONFIRMED
    chance = search(lambda a, b, c: 0.3 + a - 1.2, unlucky=0.5)
    assert chance.verdict == "not_found"
    assert "1 of 10 runs fail" in chance.statement


def test_distance_of_a_normal_parameter_is_in_standard_deviations():
    """Runs fail from a mass of 770 on, two standard deviations above the mean."""
    varied = (Varied.spread(C, 700.0, 35.0), Varied.in_range(A, *RANGES[A]))
    question = FalsifyQuestion(varied, UNTIL, budget=150, seeds=1)
    do = plant(lambda a, b, c: 0.3 + (c - 0.35))
    found = FalsifySearch(SCENARIO, question, CONDITION, do, lambda tried: None).run()
    assert found.mildest.distance == pytest.approx(2.0, rel=0.02)
    assert found.mildest.distances[0] == pytest.approx(2.0, abs=0.05)
    assert found.mildest.values[C] == pytest.approx(770, abs=4)


def test_missing_failure_and_failure_at_nominal_values_are_reported():
    held = search(lambda a, b, c: 0.1 + 0.05 * a)
    assert held.verdict == "not_found"
    assert held.mildest.distances[0] == pytest.approx(1.0, abs=0.05)
    assert "none of the" in held.statement
    begun = search(lambda a, b, c: 0.4)
    assert begun.verdict == "fails_at_start"
    assert len(begun.tried) == 3


def test_equal_inputs_give_equal_search_results():
    assert search(planted) == search(planted)


@pytest.mark.parametrize(
    ("varied", "said"),
    [
        ([(A, 0.2, 1.2)] * 2, "each key once"),
        ([("tractor.mas_kg", 0.2, 1.2)], "tractor.mas_kg"),
        ([(C, 700.0, -5.0)], "tractor.mass_kg"),
    ],
)
def test_invalid_falsification_settings_are_rejected(varied, said):
    with pytest.raises(ScenarioError, match=said):
        FalsifyQuestion(tuple(Varied.in_range(*each) for each in varied), UNTIL).check(SCENARIO)


WORDS = (
    "falsify",
    "straight_line",
    "--set",
    "plant.kind=bicycle",
    "--set",
    "guidance.kind=lqr",
    "--set",
    "duration_s=2",
)


@pytest.mark.parametrize(
    "text", ["a", "a=1", "a=1:2:3", "a=x:y", "a={normal=[1]}", "a={uniform=[1,2]}", "a={", "a=1:1", "a={normal=[1,0]}"]
)
def test_invalid_parameter_range_is_rejected(call, tmp_path, text):
    status, _, told = call(*WORDS, "--vary", text, "--until", "xte_rms > 1", "--out", "f")
    assert status == 2
    assert told.startswith("--vary a")
    assert not (tmp_path / "f").exists()


def test_falsify_command_resumes_and_records_the_failing_run(call, tmp_path, monkeypatch):
    monkeypatch.setattr(search_module, "CONFIRMED", 3)
    vary = ["--vary", "path.speed_m_s=0.5:3", "--vary", "sensors.gnss.latency_s=0:0.5"]
    words = [*WORDS, *vary, "--until", "longitudinal_rms > 0.2", "--budget", "20", "--seeds", "1", "--jobs", "1"]
    status, said, _ = call(*words, "--out", "f")
    assert status == 0
    assert "the mildest failing combination found is path.speed_m_s=" in said
    left = {path.name for path in (tmp_path / "f").iterdir()}
    assert left >= {"falsify.json", "falsify.png", "failure.rrd", "failure.parquet", "failure.toml"}
    found = json.loads((tmp_path / "f" / "falsify.json").read_text())
    again = run(load_scenario(tmp_path / "f" / "failure.toml"))
    assert again.metrics["longitudinal_rms"] > 0.2
    assert again.scenario.path.speed_m_s == found["mildest"]["values"]["path.speed_m_s"]
    status, document, _ = call(*words, "--out", "f", "--json")
    told = json.loads(document)
    assert {name: told[name] for name in found} == found
    assert (status, told["folder"], told["hints"]) == (0, "f", [])
    assert f"{found['statement']}\nf/falsify.json\n" in said


def test_falsification_reports_no_failure_if_no_run_fails(call, tmp_path, monkeypatch):
    monkeypatch.setattr(search_module, "CONFIRMED", 1)
    words = [*WORDS, "--vary", "path.speed_m_s=0.5:1", "--until", "xte_rms > 9", "--budget", "20", "--seeds", "1"]
    status, said, _ = call(*words, "--out", "f")
    assert status == 0
    assert "none of the" in said
    assert {path.name for path in (tmp_path / "f").iterdir() if path.is_file()} == {
        *("falsify.json", "falsify.png", ".agrobot-mj")
    }
