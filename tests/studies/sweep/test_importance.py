"""Sobol indices of a sweep: the design, and the indices of a function whose indices are known."""

import json
from math import pi

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import tomli_w

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.simulation.ownership import reserve
from agrobot_mj.studies.sweep.importance import importance, importance_table, read_importance
from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep, resolved

KEYS = ("steering.valve.delay_s", "steering.valve.dead_band_v", "tractor.mass_kg")
TEXT = (
    'base = "circle"\nseeds = SEEDS\nmethod = "saltelli"\nsamples = SAMPLES\n[axes]\n"seed_of_rain" = [1, 2]\n[draws]\n'
)
TEXT += "".join(f'"{key}" = {{ uniform = [{-pi}, {pi}] }}\n' for key in KEYS)


@pytest.fixture
def plan(tmp_path):
    """The plan of a design with so many samples and seeds; its two groups differ in a key that nothing reads."""

    def made(samples, seeds=1):
        (tmp_path / "mine.toml").write_text(TEXT.replace("SAMPLES", str(samples)).replace("SEEDS", str(seeds)))
        return SweepPlan(read_sweep(tmp_path / "mine.toml"))

    return made


def ishigami(x1, x2, x3, a=7.0, b=0.1):
    """The test function of Ishigami and Homma."""
    return np.sin(x1) + a * np.sin(x2) ** 2 + b * x3**4 * np.sin(x1)


def written(plan, folder, left_out=0):
    """A folder as `sweep` would leave it, with the function as its metric; in the second group without x3."""
    reserve(folder, ("sweep.toml", "sweep.parquet"))
    (folder / "sweep.toml").write_text(tomli_w.dumps(resolved(plan.sweep)))
    rows = []
    for run in list(plan.runs())[left_out:]:
        x1, x2, x3 = (run.parameters[key] for key in KEYS)
        value = ishigami(x1, x2, x3 if run.parameters["seed_of_rain"] == 1 else 0.0)
        noise = 1e-3 * (-1) ** run.seed
        rows.append(
            {"run": run.number, "seed": run.seed, **run.parameters, "outcome": "completed", "xte_rms": value + noise}
        )
    pq.write_table(pa.Table.from_pylist(rows), folder / "sweep.parquet")
    return folder


def test_the_design_takes_one_coordinate_after_the_other_from_a_second_point(plan):
    found = plan(4, seeds=2)
    assert found.total == 2 * 4 * 5 * 2
    table = np.array([[run.parameters[key] for key in KEYS] for run in found.runs()]).reshape(2, 4, 5, 2, 3)
    assert np.all(table == table[:1, :, :, :1])  # the same under every value of the axis and every seed
    for a, *mixed, b in table[0, :, :, 0]:
        for k, point in enumerate(mixed):
            assert np.flatnonzero(point != a).tolist() == [k]
            assert point[k] == b[k]


def test_known_indices_are_found_within_their_intervals(plan, tmp_path):
    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    found = importance(written(plan(512, seeds=2), tmp_path / "out"))
    # Sobol indices of the function in closed form, for a = 7 and b = 0.1.
    a, b = 7.0, 0.1
    v1, v2, v13 = 0.5 * (1 + b * pi**4 / 5) ** 2, a**2 / 8, 8 * b**2 * pi**8 / 225
    whole = v1 + v2 + v13
    wanted = dict(
        zip(KEYS, [(v1 / whole, (v1 + v13) / whole), (v2 / whole, v2 / whole), (0.0, v13 / whole)], strict=True)
    )
    for index in found[0].indices:
        first, total = wanted[index.key]
        assert index.first == pytest.approx(first, abs=1.5 * index.first_half + 0.01)
        assert index.total == pytest.approx(total, abs=1.5 * index.total_half + 0.01)
        assert index.total_half < 0.15
    assert found[0].deviation ** 2 == pytest.approx(whole, rel=0.1)
    assert found[1].indices[-1].key == KEYS[2]
    assert found[1].indices[-1].total == 0.0
    assert (tmp_path / "out" / "importance.png").stat().st_size > 5000
    assert read_importance(tmp_path / "out") == found
    assert importance_table(found).count("\n") == 4


def test_what_cannot_be_judged_is_told(plan, tmp_path, monkeypatch):
    import sys

    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    with pytest.raises(ScenarioError, match="has no results of a sweep"):
        importance(tmp_path)
    short = written(plan(4), tmp_path / "short", left_out=3)
    with pytest.raises(ScenarioError, match="3 of 40 runs are missing"):
        importance(short)
    whole = written(plan(4), tmp_path / "whole")
    with pytest.raises(ScenarioError, match="--metric xte_rmss: no such column; did you mean 'xte_rms'"):
        importance(whole, "xte_rmss")
    for name in ("outcome", "seed", "run", *KEYS):
        with pytest.raises(ScenarioError, match=f"--metric {name}: is no result of a run"):
            importance(whole, name)
    monkeypatch.setitem(sys.modules, "SALib.analyze", None)
    with pytest.raises(ScenarioError, match=r"pip install 'agrobot-mj\[studies\]'"):
        importance(whole)


def test_errors_of_runs_that_failed_are_no_data(plan, tmp_path):
    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    folder = written(plan(64), tmp_path / "out")
    rows = pq.read_table(folder / "sweep.parquet").to_pylist()
    for row in rows:  # rolls over where the first number is large, with an error that is a number
        lost = row[KEYS[0]] > 2.0
        row |= {"outcome": "rolled_over" if lost else "completed", "expected": not lost, "error": None, "wall_s": 1.0}
    pq.write_table(pa.Table.from_pylist(rows), folder / "sweep.parquet")
    lost = sum(not row["expected"] for row in rows)
    with pytest.raises(ScenarioError, match=rf"{lost} of 640 runs have none \({lost} rolled_over\).*--metric expected"):
        importance(folder)
    assert not (folder / "importance.json").exists()
    with pytest.raises(ScenarioError, match="--metric wall_s: is no result of a run"):
        importance(folder, "wall_s")
    found = importance(folder, "expected")[0]
    assert found.mean == pytest.approx(1 - lost / len(rows), abs=0.02)
    assert found.indices[0].key == KEYS[0]
    assert found.indices[0].first > 0.8


def test_a_design_of_another_kind_and_an_odd_number_of_samples_are_refused(plan, tmp_path):
    with pytest.raises(ScenarioError, match="samples: must be a power of two with saltelli, got 6"):
        plan(6)
    folder = written(plan(4), tmp_path / "out")
    text = (folder / "sweep.toml").read_text()
    (folder / "sweep.toml").write_text(text.replace('"saltelli"', '"sobol"'))
    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    with pytest.raises(ScenarioError, match="the design is 'sobol'"):
        importance(folder)
    assert not (folder / "importance.json").exists()
    assert json.loads(json.dumps(resolved(plan(4).sweep)))["samples"] == 4
