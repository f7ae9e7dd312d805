"""Conclusion of a comparison: the best law on each plant, if all seeds agree and all runs have an error."""

import pytest

from agrobot_mj.studies.compare import conclusion


def row(plant, law, seed, mse, **changed):
    """Return the keys of a row of comparison.json that determine the conclusion."""
    end = {"outcome": "completed", "expected": True, "piece": 0, "lateral_mse": mse}
    return {"plant": plant, "folder": f"{plant}-{law}-s{seed}", "seed": seed, **end, **changed}


def test_conclusion_names_the_best_law_of_each_plant():
    rows = [
        row("bicycle", "pd", 1, 0.2),
        row("bicycle", "net", 1, 0.05),
        row("mujoco", "pd", 1, 0.4),
        row("mujoco", "net", 1, 0.1),
    ]
    assert conclusion(rows) == [
        "bicycle: net has the smallest lateral mean square error in seed 1, 0.25 times the error of pd",
        "mujoco: net has the smallest lateral mean square error in seed 1, 0.25 times the error of pd"
        " and 2.00 times its error on bicycle",
    ]


def test_conclusion_is_empty_if_no_law_is_best_for_every_seed():
    rows = [
        row("mujoco", "pd", 1, 0.4),
        row("mujoco", "pd", 2, 0.1),
        row("mujoco", "net", 1, 0.1),
        row("mujoco", "net", 2, 0.2),
    ]
    assert conclusion(rows) == []


@pytest.mark.parametrize("changed", [{"outcome": "stuck", "expected": False}, {"piece": 1}])
def test_comparison_with_failed_or_partial_runs_has_no_conclusion(changed):
    assert conclusion([row("mujoco", "pd", 1, 0.4), row("mujoco", "net", 1, 0.1, **changed)]) == []


def test_comparison_of_a_single_law_has_no_conclusion():
    assert conclusion([row("mujoco", "pd", 1, 0.4), row("bicycle", "pd", 1, 0.4)]) == []
