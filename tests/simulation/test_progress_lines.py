"""Progress lines in a pipe: one line for each completed run with the remaining time, and none for fast commands."""

import time

import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation import progress
from agrobot_mj.simulation.log import Rows
from agrobot_mj.simulation.progress import span, tally
from agrobot_mj.simulation.run import run


@pytest.fixture
def clock(monkeypatch):
    """Return the clock time as a list with one value, which a test can set [s]."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_each_run_prints_a_progress_line_with_the_remaining_time(clock, capsys):
    with tally("circle: 4 runs", 4) as advance:
        for expected in (True, False, True, True):
            clock[0] += 30.0
            advance(expected=expected)
    assert capsys.readouterr().err.splitlines() == [
        "circle: 4 runs: 1 done, 90 s left",
        "circle: 4 runs: 2 done, 1 failed, 60 s left",
        "circle: 4 runs: 3 done, 1 failed, 30 s left",
        "circle: 4 runs: 4 done, 1 failed, 2 min in all",
    ]


def test_reused_results_do_not_change_the_predicted_remaining_time(clock, capsys):
    with tally("8 runs", 8, done=2) as advance:
        for _ in range(4):
            advance(there=True)
        clock[0] += 10.0
        advance()
    assert capsys.readouterr().err == "8 runs: 7 done, 10 s left\n"


def test_thousand_short_runs_print_one_progress_line_per_second(clock, capsys):
    with tally("runs", 1000) as advance:
        for _ in range(1000):
            clock[0] += 0.01
            advance()
    lines = capsys.readouterr().err.splitlines()
    assert 9 <= len(lines) <= 11
    assert lines[-1] == "runs: 1,000 done, 10 s in all"


@pytest.mark.parametrize(("quiet", "seconds"), [(True, 60.0), (False, 0.9)])
def test_no_progress_is_printed_if_quiet_or_if_a_run_takes_under_1_s(clock, capsys, quiet, seconds):
    with tally("run", 1, quiet=quiet) as advance:
        clock[0] += seconds
        advance()
    assert capsys.readouterr().err == ""


def test_tuning_progress_counts_the_evaluations_of_each_generation(clock, capsys):
    with tally("lqr: 16 evaluations", 16) as advance:
        for _ in range(2):
            clock[0] += 40.0
            advance(8)
    assert capsys.readouterr().err.splitlines()[0] == "lqr: 16 evaluations: 8 done, 40 s left"


@pytest.mark.parametrize(("seconds", "text"), [(4.4, "4 s"), (99.0, "99 s"), (300.0, "5 min"), (7200.0, "2.0 h")])
def test_durations_are_printed_in_seconds_minutes_or_hours(seconds, text):
    assert span(seconds) == text


def test_elapsed_time_is_printed_after_a_long_time_without_output(monkeypatch, capsys):
    monkeypatch.setattr(progress, "SILENCE_S", 0.05)
    with tally("figure_eight: 4 runs", 4) as advance:
        time.sleep(0.2)
        advance()
    first, *_ = capsys.readouterr().err.splitlines()
    assert first == "figure_eight: 4 runs: 0 done after 0 s"


def test_no_elapsed_time_is_printed_with_the_quiet_option(monkeypatch, capsys):
    monkeypatch.setattr(progress, "SILENCE_S", 0.05)
    with tally("figure_eight: 4 runs", 4, quiet=True):
        time.sleep(0.2)
    assert capsys.readouterr().err == ""


def test_elapsed_time_is_printed_until_the_operation_ends(monkeypatch, capsys):
    monkeypatch.setattr(progress, "SILENCE_S", 0.05)
    with progress.print_elapsed("circle: starting", quiet=False):
        time.sleep(0.2)
    lines = capsys.readouterr().err.splitlines()
    time.sleep(0.2)
    assert (lines[0], capsys.readouterr().err) == ("circle: starting: 0 s", "")


def test_run_command_prints_the_elapsed_time_only_while_it_starts(call, monkeypatch, tmp_path):
    def slow(scenario, watchers, stopped):
        time.sleep(0.2)
        watchers[0].start(scenario, None, Rows(1, 0, 0))
        time.sleep(0.2)  # the first tick compiles
        watchers[0].advance(0)
        time.sleep(0.4)
        raise ScenarioError("circle: stopped")

    monkeypatch.setattr(progress, "SILENCE_S", 0.3)
    monkeypatch.setattr("agrobot_mj.simulation.run.run", slow)
    status, _, err = call("run", "circle", "--no-rrd", "--out", str(tmp_path / "out"))
    assert (status, err.splitlines()) == (
        2,
        ["circle: starting, which compiles the first time: 0 s", "circle: stopped"],
    )


@pytest.mark.parametrize(("between", "lines"), [(0.0, ["circle: 100 % simulated"]), (1e6, [])])
def test_long_run_with_piped_output_prints_the_simulated_fraction(monkeypatch, capsys, between, lines):
    monkeypatch.setattr(progress, "SILENCE_S", between)
    run(load_scenario("circle", {"plant.kind": "bicycle", "duration_s": 1.0}), (progress.Progress(),))
    assert capsys.readouterr().err.splitlines()[-1:] == lines
