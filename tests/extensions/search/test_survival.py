"""Survival limits of each law: searches, table and figure."""

import json
from importlib import import_module

import pytest

from agrobot_mj import load_scenario
from agrobot_mj.studies.engine.tasks import Done

pytest.importorskip("agrobot_mj.extensions.learners", reason="its laws are those of the sweep `controllers`")
survival = import_module("measured.survival")


def test_every_law_is_valid_at_both_ends_of_every_search_range():
    base = load_scenario("figure_eight")
    for law, hard in survival.JOBS:
        keys = {**survival.COMMON, **hard.set, **survival.SURVIVORS[law]}
        for value in (hard.start, hard.stop):
            base.changed({**keys, hard.key: value}, files=False)


def searched(law, hardship, values):
    """Return a row of a survival search with the results (value, runs, failed)."""
    tried = [{"value": v, "runs": n, "failed": f, "holds": f / n <= 0.2, "certain": False} for v, n, f in values]
    sound = {"verdict": "fixed", "tried": [{"runs": 10, "failed": 0, "medians": {"xte_abs_p95": 0.123}}]}
    return {"law": law, "hardship": hardship, "verdict": "limit", "interval": None, "tried": tried, "sound": sound}


def test_survival_table_in_the_docs_matches_the_results():
    law, other, third = list(survival.SURVIVORS)[:3]
    slope = survival.HARDSHIPS[0].name
    rows = [
        searched(law, slope, [(0.0, 3, 0), (14.0, 3, 0), (15.0, 2, 2), (28.0, 2, 2)]),
        searched(other, slope, [(0.0, 3, 0), (28.0, 3, 0)]),
        searched(third, slope, [(0.0, 3, 1), (28.0, 3, 3)]),
    ]
    lines = survival.survival_table(rows).splitlines()
    assert f"| {law} | 0.12 | 14, not 15 |" in lines[2]
    assert f"| {other} | 0.12 | all, to 28 |" in lines[3]
    assert f"| {third} | 0.12 | not 0 |" in lines[4]
    speed = searched(law, survival.HARDSHIPS[3].name, [(1.0, 10, 0), (2.5, 10, 0), (2.7, 10, 10), (4.0, 2, 2)])
    level = searched(law, "", [(1.0, 10, 0), (2.7, 10, 0), (2.9, 10, 3), (4.0, 2, 2)])
    table = survival.survival_table([{**speed, "sound": level}])
    assert r"| 2.5, not 2.7; without: 2.7, not 2.9\* |" in table
    assert survival.survived(rows[0]) == (14.0, False)


def test_survival_figure_has_one_bar_per_law_up_to_its_limit():
    rows = []
    for law, hard in survival.JOBS:
        middle = (hard.start + hard.stop) / 2
        rows.append(searched(law, hard.name, [(hard.start, 3, 0), (middle, 10, 0), (hard.stop, 10, 10)]))
    rows[0] = searched(rows[0]["law"], rows[0]["hardship"], [(0.0, 3, 0), (28.0, 3, 0)])
    rows[1] = searched(rows[1]["law"], rows[1]["hardship"], [(0.0, 3, 3)])
    slope, soil = survival.survival_figure(rows).axes[:2]
    assert [bar.get_width() for bar in slope.patches] == [28.0] + [14.0] * (len(survival.SURVIVORS) - 2)
    assert [line.get_marker() for line in slope.lines] == [">", "x"]
    assert [bar.get_x() + bar.get_width() for bar in soil.patches] == [500.0] * len(survival.SURVIVORS)
    assert soil.get_xlim() == (900, 100)


def test_survival_search_finds_the_limit_of_a_law(monkeypatch):
    """All runs succeed up to a dead band of 3 V, and two thirds of the runs up to 4 V."""

    def performed(task):
        dead_band, seed = task.overrides.get("steering.valve.dead_band_v", 0.4), task.overrides["seed"]
        good = dead_band <= 3.0 or (dead_band <= 4.0 and seed % 3 > 0)
        return Done({"outcome": "completed" if good else "diverged", "xte_abs_p95": 0.1 + 1e-6 * seed}, {})

    monkeypatch.setattr(survival, "perform", performed)
    hard = survival.HARDSHIPS[4]._replace(set={"plant.kind": "bicycle"})
    found = survival.search(("P + feed-forward", hard), seeds=8)
    value, whole = survival.survived(found)
    assert not whole
    assert value == pytest.approx(3.0, abs=hard.tolerance)
    assert found["verdict"] == "limit"
    assert found["sound"]["verdict"] == "fixed"
    said = "with steering.valve.dead_band_v=0.4: 12 of 12 runs succeed, median xte_abs_p95 0.1"
    assert said in found["sound"]["statement"]
    assert json.loads(json.dumps(found)) == found
