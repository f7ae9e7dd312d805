"""Interrupted comparisons are resumed, and a run with an error has a row."""

import json
import shutil

import pyarrow.parquet as pq
import pytest
from broken_off import BICYCLE, check_resuming, counted

COMPARE = ("compare", "circle", "--guidance", "stanley,lqr", "--plants", "bicycle", "--seeds", 2, *BICYCLE)


@pytest.fixture
def driven(monkeypatch, tmp_path):
    return counted(monkeypatch, tmp_path)


def test_interrupted_comparison_resumes(call, driven, undrawn, tmp_path):
    check_resuming(call, driven, tmp_path, COMPARE, "comparison.json", 3)


def test_resumed_comparison_repeats_changed_or_lost_runs(call, driven, undrawn, tmp_path):
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


def test_sweep_file_written_by_a_comparison_gives_the_same_results(call, driven, undrawn, tmp_path):
    call(*COMPARE, "--no-rrd")
    assert call("sweep", "out/sweep.toml", "--out", "again", "--jobs", 1)[0] == 0
    rows = pq.read_table(tmp_path / "again" / "sweep.parquet").to_pylist()
    found = [(row["variant"], row["seed"], row["xte_rms"]) for row in rows]
    compared = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert found == [(f"bicycle-{row['guidance']}", row["seed"], row["xte_rms"]) for row in compared]


def test_failed_run_of_a_comparison_is_listed_and_other_runs_continue(call, driven, tmp_path):
    variants = ("--variant", "hard: guidance.kind=fragile, guidance.level=0.9", "--guidance", "lqr")
    command = ("compare", "circle", "--plugin", "laws.py", *variants, "--plants", "bicycle", *BICYCLE)
    status, out, err = call(*command)
    assert (status, err) == (1, "circle: failed 1 of 2: 1 error (RuntimeError: level too high (laws.py, line 23))\n")
    assert (
        "hard: failed 1 of 1: 1 error (RuntimeError: level too high (laws.py, line 23)); errors exclude these runs"
        in out
    )
    lqr, hard = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert (lqr["outcome"], "error" in lqr) == ("completed", False)
    assert (hard["outcome"], hard["expected"], hard["error"]) == (
        "error",
        False,
        "RuntimeError: level too high (laws.py, line 23)",
    )
    assert (tmp_path / "out" / "lateral_error.png").exists()
    assert call("report", "out", "--plugin", "laws.py")[0] == 0
    call(*command)
    assert [law for _, law in driven] == ["lqr", "fragile", "fragile"]  # what raised is tried again
