"""Risk estimates: random walks with known failure probability replace runs, and runs of the bicycle model."""

import json
import re
from math import sqrt
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq
import pytest
from test_splitting import NORMAL, WHOLE

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.randomness import branch, stream
from agrobot_mj.extensions.search.closeness import Closeness, Rises
from agrobot_mj.extensions.search.limit.condition import Condition
from agrobot_mj.extensions.search.limit.question import condition_of
from agrobot_mj.extensions.search.risk import command
from agrobot_mj.extensions.search.risk.command import answer
from agrobot_mj.extensions.search.risk.population import AHEAD_S, Run, populations
from agrobot_mj.extensions.search.risk.splitting import RiskQuestion, Split, estimate
from agrobot_mj.simulation import progress
from agrobot_mj.simulation.branching import Branch
from agrobot_mj.simulation.run import run
from agrobot_mj.studies.engine.tasks import failure, perform

SCENARIO = load_scenario("straight_line", {"plant.kind": "bicycle", "duration_s": 1.0})
BICYCLE = ("straight_line", "--set", "plant.kind=bicycle", "--set", "guidance.kind=lqr", "--set", "duration_s=3")


def walk(seed, branches, process):
    """Return the positions of a random walk, shape (steps,). The random stream branches as in a run."""
    generator, at, pieces = stream(seed, "walk"), 0, []
    draw = generator.standard_normal if process.up is None else generator.random
    for tick, number in [*((each.tick, each.number) for each in branches or ()), (process.steps, None)]:
        pieces.append(draw(tick - at))
        at = tick
        if number is not None:
            branch(generator, number)
    noise = np.concatenate(pieces)
    return np.cumsum(process.drift + noise if process.up is None else np.where(noise < process.up, 1.0, -1.0))


def walking(process):
    """Return a function that replaces the run of each task by a random walk, determined by seed and branches."""

    def do(tasks):
        found = []
        for task in tasks:
            places = walk(task.overrides["seed"], task.branches, process)
            highest = np.maximum.accumulate(places)
            new = np.flatnonzero(np.diff(highest, prepend=-np.inf) > 0)
            rises = [[int(k) + 1, float(places[k])] for k in new]
            numbers = {"outcome": "completed", "expected": True, "error": None, "xte_abs_max": float(highest[-1])}
            found.append({**numbers, "rises": rises, "ticks": process.steps})
        return found

    return do


def risk_of(process, first_seed=1, **more):
    question = RiskQuestion(f"xte_abs_max >= {process.top}", **more)
    condition = Condition(question.until, ["xte_abs_max"])
    scenario = SCENARIO.changed({"seed": first_seed})
    found = populations(scenario, question, condition, walking(process), lambda population: None)
    return answer(scenario, question, found)


@pytest.mark.parametrize(
    "process",
    [pytest.param(WHOLE, id="whole steps"), pytest.param(NORMAL, id="normal steps", marks=pytest.mark.slow)],
)
def test_splitting_gives_the_known_failure_probability(process):
    """Intervals of few splitting runs contain the probability in 90 % of cases. At least 15 of 20 intervals do with a
    probability of 96 %."""
    found = [risk_of(process, 1 + 1000 * k, particles=25, repeats=4).estimate for k in range(20)]
    mean, error = np.mean([f.probability for f in found]), np.std([f.probability for f in found], ddof=1) / sqrt(20)
    assert error < 0.2 * process.exact
    assert mean == pytest.approx(process.exact, abs=3 * error)
    assert sum(f.low <= process.exact <= f.high for f in found) >= 15


def test_splitting_needs_a_tenth_of_the_direct_runs_at_probability_1e_4():
    """Direct simulation needs p (1 - p) / error^2 runs for the same standard error."""
    process = NORMAL._replace(top=21.5)
    assert 0.5e-4 < process.exact < 2e-4
    found = risk_of(process, particles=60, repeats=10)
    assert found.estimate.low < process.exact < found.estimate.high
    assert process.exact / found.estimate.error**2 > 10 * found.worth


def test_equal_inputs_give_equal_risk_estimates():
    assert risk_of(WHOLE, particles=20, repeats=3) == risk_of(WHOLE, particles=20, repeats=3)


def test_invalid_risk_options_are_rejected():
    found = risk_of(WHOLE._replace(top=70), particles=20, repeats=3)
    assert found.estimate.probability == 0.0
    assert 0 < found.estimate.high < 1e-3
    assert "no failure in" in found.statement


def test_risk_interval_of_a_certain_failure_is_the_wilson_interval():
    found = risk_of(WHOLE._replace(top=-70), particles=20, repeats=3)
    assert (found.estimate.probability, found.estimate.high, found.worth) == (1.0, 1.0, 60)
    assert found.estimate.low == pytest.approx(60 / (60 + 1.96**2), abs=1e-4)
    assert "Monte Carlo" not in found.statement


def test_risk_search_ends_below_the_minimum_probability():
    found = risk_of(NORMAL._replace(top=60.0), particles=20, repeats=3, least=1e-3)
    assert found.estimate.probability == 0.0
    assert 0 < found.estimate.high < 1e-3


def raising(until, runs):
    """Return the risk estimate from runs of which the first `runs` of five raise an error, and all others succeed."""
    question = RiskQuestion(until, particles=5, repeats=2)
    good = {"outcome": "completed", "expected": True, "error": None, "xte_abs_max": 0.5, "rises": [[1, 0.5]]}

    def do(tasks):
        return [failure("E: x").row if k % 5 < runs else {**good, "ticks": 20} for k, _ in enumerate(tasks)]

    found = populations(SCENARIO, question, Condition(until, ["xte_abs_max"]), do, lambda p: None)
    return answer(SCENARIO, question, found)


@pytest.mark.parametrize("until", ["xte_abs_max > 1", "outcome == rolled_over"])
def test_runs_that_raise_errors_count_as_failed_and_are_reported(until):
    found = raising(until, 2)
    assert found.estimate.probability > 0.3
    assert re.search(r"; these include \d+ error", found.statement)


def test_risk_search_is_aborted_if_every_run_raises_an_error():
    with pytest.raises(ScenarioError, match="every run raised an error, so the risk is unknown; fix this error: E: x"):
        raising("xte_abs_max > 1", 5)


def test_risk_interval_is_a_student_interval_of_the_log_probability():
    splits = [Split(p, p, 1, ((0.0, p),), 1) for p in (1e-4, 2e-4, 3e-4)]
    found = estimate(splits, 10)
    assert found.probability == pytest.approx(2e-4)
    assert found.error == pytest.approx(1e-4 / sqrt(3))
    assert found.high / found.probability == pytest.approx(found.probability / found.low)
    assert found.high == pytest.approx(2e-4 * np.exp(4.302653 / 2 / sqrt(3)), rel=1e-6)


class Finished(NamedTuple):
    """Finished execution of the splitting algorithm."""

    split: Split
    runs: tuple[Run, ...] = (Run(1, (), ((1, 0.5),), 20, False),)


@pytest.mark.parametrize(("empty", "warned"), [(1, False), (2, True)])
def test_report_states_that_many_splittings_found_no_failure(empty, warned):
    """The distribution of the estimates is then so skewed that their spread is too small."""
    done = [Finished(Split(1e-4 * (k >= empty), 1e-3, 1, ((0.5, 1e-3),), 40)) for k in range(5)]
    statement = answer(SCENARIO, RiskQuestion("xte_abs_max > 1", 10, 5), done).statement
    assert ("2 of 5 splittings found no failure, so the interval is unreliable; increase" in statement) is warned


# --- runs of the simulator ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_risk_command_resumes_and_saves_a_repeatable_failure(call, tmp_path, plant):
    words = ["risk", *BICYCLE, "--set", f"plant.kind={plant}", "--until", "xte_abs_max > 0.01"]
    words += ["--particles", "6", "--repeats", "2", "--jobs", "1"]
    status, said, _ = call(*words, "--out", "r")
    assert status == 0
    assert "a run fails with a probability of" in said
    assert {"risk.json", "risk.png", "failure.rrd", "failure.parquet"} <= {
        path.name for path in (tmp_path / "r").iterdir()
    }
    found = json.loads((tmp_path / "r" / "risk.json").read_text())
    assert found["low"] < found["probability"] < found["high"]
    (failed,) = found["failure"]
    scenario = load_scenario("straight_line", {"plant.kind": plant, "guidance.kind": "lqr", "duration_s": 3})
    log = run(scenario.changed({"seed": failed["seed"]}), branches=[Branch(*each) for each in failed["branches"]])
    assert log.metrics["xte_abs_max"] > 0.01
    kept = pq.read_table(tmp_path / "r" / "failure.parquet")
    assert kept["y"].to_pylist() == log.column("y").tolist()
    rows = {path: path.stat().st_mtime_ns for path in (tmp_path / "r" / "rows").rglob("*.json")}
    (tmp_path / "r" / "failure.rrd").unlink()
    status, document, _ = call(*words, "--out", "r", "--json")
    told = json.loads(document)
    assert {name: told[name] for name in found} == found
    assert (status, told["folder"], told["hints"]) == (0, "r", [])
    assert f"{found['statement']}\nr/risk.json\n" in said
    assert (tmp_path / "r" / "failure.rrd").is_file()
    assert len([path for path in rows if path.stat().st_mtime_ns != rows[path]]) == 1


@pytest.mark.parametrize("quiet", [False, True])
def test_progress_of_each_splitting_round_is_printed_to_stderr(call, monkeypatch, quiet):
    """The first round simulates all paths, which may take minutes."""
    monkeypatch.setattr(progress, "BETWEEN_LINES_S", 0.0)
    words = ["risk", *BICYCLE[:-1], "duration_s=1", "--until", "xte_abs_max > 0.01", "--particles", "2"]
    _, said, error = call(*words, "--repeats", "2", "--jobs", "1", *(["--quiet"] if quiet else []))
    assert ("straight_line, round 1: 4 runs: 4 done" in error) is not quiet
    assert "round" not in said


@pytest.mark.parametrize(("score", "label"), [(None, "margin to failure, 1 s ahead [-]"), ("steer", "steer")])
def test_failure_level_is_not_drawn_in_the_risk_figure(score, label):
    """Levels are extrapolated margins or scores, so a level above 0 is not a failure."""
    drawn = command.figure([Split(1e-4, 1e-3, 2, ((-0.5, 0.1), (0.1, 1e-3)), 40)], [], score)
    chances = next(axes for axes in drawn.axes if axes.get_xlabel() == label)
    assert [text.get_text() for text in chances.texts] == ["fail: 0.0001"]
    assert [list(line.get_ydata()) for line in chances.lines][-1] == [1e-4, 1e-4]
    assert chances.get_ylim()[0] < 1e-4
    assert not any(axes.texts for axes in drawn.axes if axes is not chances)


def test_failure_from_a_missing_metric_is_reported(call, tmp_path):
    words = ["risk", *BICYCLE[:-1], "duration_s=0.1", "--particles", "2", "--repeats", "2", "--jobs", "1"]
    status, said, _ = call(*words, "--until", "xte_abs_max > 9", "--out", "r")
    assert status == 0
    assert "a run fails with a probability of 1 (95 % interval 0.51 to 1), from 4 runs" in said
    assert "; these include 4 without xte_abs_max" in said
    assert "1 of 2: probability 1 from 2 runs\n" in said
    assert (tmp_path / "r" / "risk.png").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--until", "xte_abs_max"], "--until 'xte_abs_max'"),
        (["--until", "xte_abs_max > 1e999"], "is too large a number"),
        (["--until", f"xte_abs_max > {10**400}"], "is too large a number"),
        (["--until", "position_nees > 3"], "the signal of the metric position_nees is unknown"),
        (["--until", "xte_rms > 1", "--score", "rol"], "--score rol: these runs do not have this signal"),
        (["--until", "xte_rms > 1", "--set", "seed=9223372036854775800"], "seed"),
        (["--until", "xte_rms > 1", "--least", "2"], "--least must be between 0 and 1"),
    ],
)
def test_invalid_risk_command_arguments_are_rejected(call, tmp_path, words, said):
    status, _, told = call("risk", *BICYCLE, *words, "--out", "r")
    assert status == 2
    assert said in told
    assert not (tmp_path / "r").exists()


TREES = {"sensors.gnss.multipath_sigma_m": 0.03, "sensors.gnss.multipath_time_s": 1.0, "guidance.kind": "lqr"}
TREES |= {"plant.kind": "bicycle", "estimator.initial_yaw_sigma_deg": 0.5}


def splittings(duration, at, particles, repeats, least=1e-6):
    """Return a straight-line scenario below trees, and its splitting runs, which fail at an error of `at` [m]."""
    scenario = load_scenario("straight_line", {**TREES, "duration_s": duration})
    question = RiskQuestion(f"xte_abs_max > {at}", particles, repeats, least=least)
    condition = condition_of(question.until, scenario)

    def do(tasks):
        return [perform(task).row for task in tasks]

    return scenario, populations(scenario, question, condition, do, lambda p: None)


def test_branched_runs_are_equal_until_the_branch_and_then_differ():
    scenario, (found,) = splittings(2.0, 0.5, 6, 1, least=0.1)
    rises, copies = Rises(Closeness("xte_abs_max > 0.5"), AHEAD_S), [each for each in found.runs if each.branches]
    assert len(copies) > 5
    for each in copies:
        tick, drawn = each.branches[-1].tick, scenario.changed({"seed": each.seed})
        parent, copy = (run(drawn, branches=branches) for branches in (each.branches[:-1], each.branches))
        past = [(k, close) for k, close in rises(parent)["rises"] if k <= tick]
        assert [rise for rise in each.rises if rise[0] <= tick] == past
        assert past[-1][0] == tick
        same = parent.column("gnss_y") == copy.column("gnss_y")
        assert same[: tick + 1].all()  # the first fix behind the branch was measured before it
        assert not same[tick + 1 :].any()


@pytest.mark.slow
def test_multilevel_splitting_and_simulation_agree_on_the_bicycle_model():
    """About one run in ten fails. Both estimates agree within three standard errors."""
    at, plain = 0.06, 200
    scenario, found = splittings(5.0, at, 20, 20)
    split = estimate([each.split for each in found], 20)
    far = [run(scenario.changed({"seed": 200_000 + k})).metrics["xte_abs_max"] for k in range(plain)]
    share = np.mean(np.array(far) > at)
    assert split.error < 0.3 * split.probability
    assert split.probability == pytest.approx(share, abs=3 * sqrt(split.error**2 + share * (1 - share) / plain))
