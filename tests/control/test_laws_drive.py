"""Guidance laws in closed loop with sensors and estimator, also in reverse for the laws that support it."""

from typing import Any

import numpy as np
import pytest
from extras import NEEDS_CASADI
from removed import needs_all
from turns import by_turns

from agrobot_mj.control import Nmpc
from agrobot_mj.control.following import Following
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.reference import families
from agrobot_mj.simulation.run import run

INSIDE = [kind for kind in families()["guidance"].values() if not kind().outside]


def kinds(laws: list[Any]) -> list[Any]:
    """Return the kinds of guidance laws as test parameters; `nmpc` is skipped without casadi."""
    return [pytest.param(law().kind, marks=[NEEDS_CASADI] if law is Nmpc else [], id=law.__name__) for law in laws]


LAWS = kinds([law for law in INSIDE if law.holds_lane_change])
FOLLOWING = kinds([law for law in INSIDE if issubclass(law, Following)])
PLANTS = ["bicycle", "mujoco"]
LANE_CHANGE = {"path.kind": "lane_change", "path.straight_m": 12.0}
WORN = {"kind": "valve_wear", "gain_share": 0.4, "dead_band_v": 0.8}


@pytest.mark.parametrize("kind", kinds(INSIDE))
def test_every_law_starts_from_rest_and_follows_a_line(kind: str) -> None:
    keys = {"guidance.kind": kind, "controller.kind": "pi", "plant.kind": "bicycle", "duration_s": 20.0}
    log = run(load_scenario("straight_line", keys))
    assert log.outcome == "completed"
    assert log.metrics["progress"] > 0.9
    assert log.metrics["xte_abs_p95"] < 1.0
    assert {c.name for c in log.scenario.guidance.columns} <= set(log.signals.column_names)


@needs_all
def test_at_least_seven_laws_are_tested_on_the_lane_change() -> None:
    assert len(LAWS) >= 7


@pytest.mark.parametrize(("kind", "plant"), by_turns(LAWS, PLANTS))
def test_law_follows_lane_change_with_rms_error_below_25_cm(kind: str, plant: str) -> None:
    keys = {"guidance.kind": kind, "controller.kind": "pi", "plant.kind": plant, **LANE_CHANGE}
    log = run(load_scenario("figure_eight", keys))
    assert log.outcome == "completed"
    assert log.metrics["xte_rms"] < 0.25
    assert {c.name for c in log.scenario.guidance.columns} <= set(log.signals.column_names)


@pytest.mark.parametrize("kind", FOLLOWING)
def test_path_following_law_tracks_figure_eight_within_12_cm(kind: str) -> None:
    keys = {"guidance.kind": kind, "plant.kind": "bicycle", "path.turns": 1, "duration_s": 60.0}
    log = run(load_scenario("figure_eight", keys))
    assert log.metrics["xte_abs_p95"] < 0.12


REVERSING = {
    "path.kind": "manoeuvre",
    "path.piece": [
        {"kind": "straight", "length_m": 10.0},
        {"kind": "clothoid", "length_m": 3.0, "from_per_m": 0.0, "to_per_m": 0.12, "reverse": True},
        {"kind": "arc", "radius_m": 1 / 0.12, "angle_deg": 40.0, "side": "left", "reverse": True},
        {"kind": "clothoid", "length_m": 3.0, "from_per_m": 0.12, "to_per_m": 0.0, "reverse": True},
        {"kind": "straight", "length_m": 8.0, "reverse": True},
        {"kind": "straight", "length_m": 8.0},
    ],
}


@pytest.mark.parametrize(("kind", "plant"), by_turns(FOLLOWING, PLANTS[::-1]))
def test_path_following_law_reverses_along_an_arc(kind: str, plant: str) -> None:
    log = run(load_scenario("figure_eight", {"guidance.kind": kind, "plant.kind": plant, **REVERSING}))
    assert log.outcome == "completed"
    assert log.column("speed").min() < -0.5
    assert np.abs(log.column("e_cross_track_hat")).max() < 0.5
    assert log.metrics["xte_rms"] < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
@pytest.mark.parametrize("kind", LAWS)
def test_error_with_worn_valve_does_not_grow_over_three_laps(kind: str, plant: str) -> None:
    keys = {"guidance.kind": kind, "controller.kind": "pi", "plant.kind": plant, "path.turns": 3, "fault": [WORN]}
    log = run(load_scenario("figure_eight", keys))
    assert log.outcome == "completed"
    turns = [turn["xte_abs_p95"] for turn in log.metrics["per_turn"]]
    assert max(turns) < 0.5
    assert turns[2] < 1.3 * turns[1] + 0.02  # the error does not grow from turn to turn
