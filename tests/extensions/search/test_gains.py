"""Default gains are the result of the search for all laws; the paper's gains are available by name."""

import json
import tomllib
from operator import attrgetter
from pathlib import Path

import pytest

from agrobot_mj import load_scenario
from agrobot_mj.control.gains import PAPER, TUNED
from agrobot_mj.extensions.search.tune import tunable
from agrobot_mj.extensions.search.tuning_cases import read_tuning
from agrobot_mj.scenario.reference import families
from agrobot_mj.scenario.schema import Scenario, resolve

SEARCH = read_tuning("gains")
LAWS = [k for k, law in SEARCH.laws.items() if law.set.get("guidance.kind", "kinematic") in families()["guidance"]]
TRACES = Path(__file__).parents[3] / "docs" / "tuning"


def shipped(law: str) -> Scenario:
    """Return a scenario with the kinds of a tuned law and without gains."""
    kinds = {key: value for key, value in SEARCH.laws[law].set.items() if key.endswith(".kind")}
    return load_scenario("straight_line", kinds)


@pytest.mark.parametrize("law", LAWS)
def test_shipped_gains_equal_the_search_result(law):
    found, scenario = json.loads((TRACES / f"{law}.json").read_text()), shipped(law)
    assert {key: attrgetter(key)(scenario) for key in found["gains"]} == found["gains"]
    assert found["law"] == scenario.law
    assert {key: tuple(limits) for key, limits in found["ranges"].items()} == tunable(scenario)
    (*keys, cost), *trace = found["trace"]
    assert (keys, cost) == (list(found["gains"]), "cost")
    assert len(trace) == found["evaluations"] == SEARCH.budget
    best = min(trace, key=lambda row: row[-1])
    assert dict(zip(keys, best, strict=False)) == found["gains"]


@pytest.mark.parametrize("law", SEARCH.laws)
def test_gain_search_does_not_worsen_any_law_on_its_training_cases(law):
    training = json.loads((TRACES / f"{law}.json").read_text())["training"]
    assert training["score"]["mean"] <= training["score_before"]["mean"]


def test_every_law_with_tuned_gains_has_a_shipped_search_result():
    laws = [shipped(name) for name in LAWS]
    assert set(TUNED).union(*(law.guidance.tuned for law in laws)) <= {law.law for law in laws}


@pytest.mark.parametrize("kind", ["pd", "pd_t2fnn", "pd_t1fnn", "pd_isgn"])
def test_figure_eight_scenario_keeps_the_published_gains(kind):
    paper = load_scenario("figure_eight", {"controller.kind": kind})
    assert paper.law in PAPER
    assert (paper.guidance.gain_per_m, paper.controller.kp, paper.controller.kd) == (0.4, 0.4, 0.0)
    assert paper.guidance.scheduled_above_m_s is None
    learns = getattr(paper.controller, "network", paper.controller)
    assert getattr(learns, "alpha", 0.02) == 0.02
    lane = load_scenario("lane_change", {"controller.kind": kind})
    assert paper.changed({"gains": "tuned"}).controller == lane.controller


@pytest.mark.parametrize("keys", [{"controller.kind": "pi"}, {"guidance.kind": "feedforward", "controller.kind": "pd"}])
def test_laws_not_in_the_paper_have_equal_gains_in_all_scenarios(keys):
    paper, other = load_scenario("figure_eight", keys), load_scenario("lane_change", keys)
    assert (paper.guidance, paper.controller) == (other.guidance, other.controller)


def test_specified_gains_are_kept_and_others_are_those_of_the_law():
    given = load_scenario("lane_change", {"controller.kp": 0.33})
    assert given.controller.kp == 0.33
    assert given.changed({"controller.kind": "pi"}).controller.kp == 0.33
    law = load_scenario("lane_change")
    assert (
        law.changed({"controller.kind": "pi"}).controller
        == load_scenario("lane_change", {"controller.kind": "pi"}).controller
    )


@pytest.mark.parametrize("name", ["figure_eight", "lane_change"])
def test_resolved_scenario_states_its_gains_and_is_read_back_unchanged(name):
    scenario = load_scenario(name)
    assert f"kp = {scenario.controller.kp}" in scenario.to_toml()
    assert resolve(tomllib.loads(scenario.to_toml()), name) == scenario
    assert scenario.hash8 == scenario.changed({"controller.kp": scenario.controller.kp}).hash8
