"""Numeric options of searches reject text, NaN and infinity before any run."""

import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.search import tune as study
from agrobot_mj.extensions.search.limit.question import MOST_CONFIDENT, Question, check
from agrobot_mj.extensions.search.tune import check_size, tune
from agrobot_mj.extensions.search.tuning_cases import read_tuning
from agrobot_mj.scenario.loading import load_scenario

LIMIT = {"key": "path.speed_m_s", "start": 1.0, "stop": 2.0, "until": "xte_rms > 1"}


@pytest.mark.parametrize(
    "odd",
    [
        *({"tolerance": value} for value in (float("nan"), float("inf"), 0.0, -1.0)),
        *({"confidence": value} for value in (float("nan"), 0.0, 1.0, 0.9999999999999999)),
        *({"reliability": value} for value in (float("nan"), 0.0, 1.0)),
        {"start": -1e308, "stop": 1e308},
    ],
    ids=str,
)
def test_numeric_limit_options_out_of_range_are_rejected(odd, monkeypatch):
    monkeypatch.setattr(
        "agrobot_mj.extensions.search.limit.question.metric_names", lambda scenario: pytest.fail("a run")
    )
    with pytest.raises(ScenarioError, match=rf"--(tolerance|range).*(at most|between 0 and {MOST_CONFIDENT}|wide)"):
        check(Question(**{**LIMIT, **odd}), {"paper": load_scenario("circle")})


@pytest.mark.parametrize(("budget", "seeds"), [(64, 200_000), (10**9, 1), (8, 10**400)])
def test_excessively_large_search_is_rejected_before_building_cases(budget, seeds, monkeypatch, tmp_path):
    monkeypatch.setattr(study, "tuning_cases", lambda *_: pytest.fail("built"))
    with pytest.raises(
        ScenarioError, match=r"--budget .* --seeds .*: this needs more than 100,000 runs; reduce the budget"
    ):
        tune(
            load_scenario("straight_line", {"guidance.kind": "stanley"}),
            read_tuning("surfaces"),
            tmp_path,
            budget,
            seeds,
        )


def test_search_of_typical_size_is_accepted():
    check_size(read_tuning("surfaces"), 64, 20)
