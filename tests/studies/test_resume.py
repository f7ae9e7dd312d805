"""Comparisons, limits and tunings go on where they were broken off, and a run that raises is a row."""

import json
import shutil
from importlib import import_module

import pyarrow.parquet as pq
import pytest

from agrobot_mj.studies.engine import tasks

LAWS = '''
"""A law that drives on, or raises."""

from typing import Literal

from agrobot_mj.control import GuidanceLaw
from agrobot_mj.core.signals import Command


class Fragile(GuidanceLaw):
    """Raises where its gain is large."""

    kind: Literal["fragile"] = "fragile"
    gain: float = 0.1
    """Gain [-]."""

    @property
    def tunable(self):
        return {"gain": (0.1, 1.0)}

    def update(self, state, situation, dt):
        if self.gain > 0.5:
            raise RuntimeError("gain too large")
        return None, Command(steer=0.0, speed=1.0)
'''
BICYCLE = ("--set", "plant.kind=bicycle", "--set", "duration_s=1", "--jobs", 1, "--out", "out")
COMPARE = ("compare", "circle", "--guidance", "stanley,lqr", "--plants", "bicycle", "--seeds", 2, *BICYCLE)
LIMIT = ("limit", "circle", "--key", "path.radius_m", "--range", "6:2", "--until", "xte_rms > 0.02", "--max-seeds", 3)
LIMIT += ("--guidance", "stanley", *BICYCLE)
TUNE = ("tune", "circle", "--guidance", "stanley", "--cases", "mine.toml", "--budget", 8, *BICYCLE)
WALL = ("wall_s", "real_time_factor")


@pytest.fixture
def driven(monkeypatch, tmp_path):
    """Runs driven so far, as seed and law; the n-th is broken off if `driven.most` is n."""
    (tmp_path / "mine.toml").write_text('seeds = 2\n[[training]]\nname = "a"\n[[test]]\nname = "b"\n')
    (tmp_path / "laws.py").write_text(LAWS)
    real, seen = tasks.run, Driven()

    def run(scenario, *watchers, branches=None):
        if len(seen) == seen.most:
            raise KeyboardInterrupt
        seen.append((scenario.seed, scenario.law))
        return real(scenario, *watchers)

    monkeypatch.setattr(tasks, "run", run)
    return seen


class Driven(list):
    most = None


@pytest.fixture
def undrawn(monkeypatch):
    """Comparisons leave no figures: a second each, which other tests look at."""
    monkeypatch.setattr(import_module("agrobot_mj.studies.compare"), "write_figures", lambda runs, folder: [])


def answer(folder, name):
    """What a study found, wall times aside."""
    found = json.loads((folder / name).read_text())
    rows = found if isinstance(found, list) else []
    return [{key: value for key, value in row.items() if key not in WALL} for row in rows] or found


STUDIES = pytest.mark.parametrize(
    ("command", "name", "most"),
    [(COMPARE, "comparison.json", 3), (LIMIT, "limit.json", 5), (TUNE, "tuning.json", 7)],
    ids=["compare", "limit", "tune"],
)


@STUDIES
def test_an_interrupted_study_resumes(call, driven, undrawn, tmp_path, command, name, most):
    driven.most = most
    assert call(*command)[0] == 130
    assert not (tmp_path / "out" / name).exists()
    driven.most = None
    assert call(*command)[0] == 0
    resumed, total = answer(tmp_path / "out", name), len(driven)
    shutil.move(tmp_path / "out", tmp_path / "resumed")
    assert call(*command)[0] == 0
    assert len(driven) == 2 * total
    assert answer(tmp_path / "out", name) == resumed
    assert call(*command)[0] == 0
    assert len(driven) == 2 * total  # nothing is driven again


def test_a_comparison_repeats_runs_that_changed_or_were_lost(call, driven, undrawn, tmp_path):
    call(*("lqr" if word == "stanley,lqr" else word for word in COMPARE), "--no-rrd")
    assert len(driven) == 2
    call(*COMPARE, "--no-rrd")
    assert len(driven) == 4  # the law that was there is not driven again
    call(*COMPARE, "--no-rrd", "--set", "duration_s=0.5")
    call(*COMPARE, "--no-rrd")
    assert len(driven) == 12
    shutil.rmtree(tmp_path / "out" / "bicycle-lqr-s1")
    call(*COMPARE, "--no-rrd")
    assert driven[12:] == [(1, "lqr")]
    call(*COMPARE)
    assert len(driven) == 17
    assert (tmp_path / "out" / "comparison.rrd").stat().st_size > 1000
    (tmp_path / "out" / "comparison.rrd").unlink()
    call(*COMPARE)
    assert len(driven) == 17
    assert (tmp_path / "out" / "comparison.rrd").stat().st_size > 1000


def test_a_comparison_is_a_sweep(call, driven, undrawn, tmp_path):
    call(*COMPARE, "--no-rrd")
    assert call("sweep", "out/sweep.toml", "--out", "again", "--jobs", 1)[0] == 0
    rows = pq.read_table(tmp_path / "again" / "sweep.parquet").to_pylist()
    found = [(row["variant"], row["seed"], row["xte_rms"]) for row in rows]
    compared = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert found == [(f"bicycle-{row['guidance']}", row["seed"], row["xte_rms"]) for row in compared]


def test_a_crashing_run_of_a_comparison_is_a_row_and_the_others_go_on(call, driven, tmp_path):
    variants = ("--variant", "hard: guidance.kind=fragile, guidance.gain=0.9", "--guidance", "lqr")
    command = ("compare", "circle", "--plugin", "laws.py", *variants, "--plants", "bicycle", *BICYCLE)
    status, out, err = call(*command)
    assert (status, err) == (1, "circle: failed 1 of 2: 1 error (RuntimeError: gain too large)\n")
    assert "bicycle-hard: failed 1 of 1: 1 error (RuntimeError: gain too large); no errors of these" in out
    lqr, hard = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert (lqr["outcome"], "error" in lqr) == ("completed", False)
    assert (hard["outcome"], hard["expected"], hard["error"]) == ("error", False, "RuntimeError: gain too large")
    assert (tmp_path / "out" / "lateral_error.png").exists()
    assert call("report", "out", "--plugin", "laws.py")[0] == 0
    call(*command)
    assert [law for _, law in driven] == ["lqr", "fragile", "fragile"]  # what raised is tried again


def test_crashing_runs_of_a_limit_count_as_failed_and_are_reported(call, driven, tmp_path):
    where = ("--key", "guidance.gain", "--range", "0.1:0.9", "--until", "outcome == diverged", "--max-seeds", 2)
    command = ("limit", "circle", "--plugin", "laws.py", "--guidance", "fragile", *where)
    status, _, err = call(*command, "--set", "expected_outcome=completed", *BICYCLE)
    assert (status, err) == (0, "a run raised an error: RuntimeError: gain too large\n")
    (law,) = json.loads((tmp_path / "out" / "limit.json").read_text())["laws"]
    assert law["limit"] == pytest.approx(0.5, abs=0.02)
    assert law["tried"][-1]["outcomes"] == {"error": 2}


def test_gains_that_crash_a_run_cost_most(call, driven, tmp_path):
    command = ("tune", "circle", "--plugin", "laws.py", "--guidance", "fragile", "--cases", "mine.toml", "--budget", 8)
    status, _, err = call(*command, *BICYCLE)
    assert (status, err) == (0, "a run raised an error: RuntimeError: gain too large\n")
    found = json.loads((tmp_path / "out" / "tuning.json").read_text())
    assert found["gains"]["guidance.gain"] <= 0.5
    assert max(cost for _, cost in found["trace"][1:]) == 45.0


@pytest.mark.parametrize(
    ("command", "name"),
    [(LIMIT, "limit.json"), (TUNE, "tuning.json")],
    ids=["limit", "tune"],
)
@pytest.mark.slow
def test_two_processes_find_the_same(call, tmp_path, command, name):
    """Those of a comparison: tests/test_cli.py; of a sweep, by default: tests/studies/sweep."""
    (tmp_path / "mine.toml").write_text('seeds = 2\n[[training]]\nname = "a"\n[[test]]\nname = "b"\n')
    one, two = (call(*command, "--jobs", jobs, "--out", f"jobs{jobs}") for jobs in (1, 2))
    assert (one[0], two[0]) == (0, 0)
    assert answer(tmp_path / "jobs1", name) == answer(tmp_path / "jobs2", name)
