"""Metrics compared with hand-computed cases and with geometry."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.metrics import METRICS, Metric, RunView, errors, metrics
from agrobot_mj.metrics.base import LEAST, abs_p95, mean, mean_magnitude, rms
from agrobot_mj.metrics.crosstrack import cross_track
from agrobot_mj.paths import Circle, FigureEight, Line, Swaths
from agrobot_mj.simulation.columns import COLUMNS


class FakeLog:
    """Log made of columns; all other columns are zero."""

    def __init__(self, path: Any, t: Any, **columns: Any) -> None:
        self.scenario = SimpleNamespace(path=path, duration_s=None)
        self.t = np.asarray(t, dtype=float)
        self.columns = {name: np.zeros(len(self.t)) for name in COLUMNS} | {"t": self.t}
        self.columns |= {name: np.zeros(len(self.t)) + np.asarray(v) for name, v in columns.items()}

    def column(self, name: str) -> Any:
        return self.columns[name]


def points_beside(path: Any, t: Any, ahead: Any, left: Any) -> tuple[Any, Any]:
    """Return points at a signed distance `left` from the path, `ahead` metres beyond the reference at time `t`."""
    r = np.array([path.at(s) for s in (t + np.asarray(ahead) / path.speed_m_s)])
    return r[:, 0] - left * np.sin(r[:, 4]), r[:, 1] + left * np.cos(r[:, 4])


def four_ticks(**columns: Any) -> FakeLog:
    """Return a log of two laps of a circle of one second each, with two samples per lap."""
    circle = Circle(radius_m=1 / (2 * np.pi), speed_m_s=1, turns=2, ramp_s=0)
    return FakeLog(circle, often([0.0, 1.0, 1.5, 2.0]), **{name: often(values) for name, values in columns.items()})


def often(values: Any) -> Any:
    """Return values repeated to the minimum number of samples for a statistic."""
    return np.repeat(values, LEAST) if np.ndim(values) else values


def test_lateral_error_metrics_match_hand_calculation() -> None:
    m = metrics(four_ticks(e_lateral=[1, -1, 2, -4]))
    assert m["lateral_mse"] == pytest.approx(22 / 4)
    assert m["lateral_rms"] == pytest.approx((22 / 4) ** 0.5)
    assert m["lateral_abs_p95"] == pytest.approx(4.0)
    assert [turn["lateral_mse"] for turn in m["per_turn"]] == pytest.approx([1, 10])


def test_longitudinal_and_yaw_rate_error_match_hand_calculation() -> None:
    m = metrics(four_ticks(e_longitudinal=[3, -4, 0, 0], e_yaw_rate=[0, 0, 0.1, -0.1]))
    assert m["longitudinal_rms"] == pytest.approx(2.5)
    assert m["yaw_rate_error_rms"] == pytest.approx(0.1 / 2**0.5)
    assert m["per_turn"][0]["longitudinal_rms"] == pytest.approx((25 / 2) ** 0.5)
    assert [turn["yaw_rate_error_rms"] for turn in m["per_turn"]] == pytest.approx([0, 0.1])


def test_network_fraction_of_the_command_matches_hand_calculation() -> None:
    m = metrics(four_ticks(tau_c=[1, -3, 1, 1], tau_n=[-1, 1, 3, -3]))
    assert m["nn_share"] == pytest.approx([1 / 3, 3 / 4])


@pytest.mark.parametrize("tau_n", [0.0, np.nan])
@pytest.mark.parametrize("tau_c", [0.0, 0.2])
def test_network_fraction_of_the_command_is_zero_without_a_network(tau_c: float, tau_n: float) -> None:
    assert metrics(four_ticks(tau_c=tau_c, tau_n=tau_n))["nn_share"] == [0.0, 0.0]


def test_nees_nis_and_steering_saturation_metrics_are_means_over_ticks() -> None:
    m = metrics(
        four_ticks(position_nees=[1, 3, np.nan, 2], position_nis=[np.nan, 1, 2, np.nan], steer_saturated=[0, 1, 0, 0])
    )
    assert m["position_nees"] == pytest.approx(2)
    assert m["position_nis"] == pytest.approx(1.5)
    assert m["steer_saturated_fraction"] == 0.25


def test_every_lap_has_all_error_metrics_of_the_run() -> None:
    m = metrics(four_ticks(), outcome="completed")
    total = {"lateral_mse", "lateral_rms", "lateral_abs_p95", "longitudinal_rms", "xte_rms", "xte_abs_p95"}
    total |= {"xte_abs_max", "yaw_rate_error_rms"}
    assert next(iter(m)) == "outcome"
    assert set(m) >= total | {
        "outcome",
        "progress",
        "per_turn",
        "nn_share",
        "position_nees",
        "position_nis",
        "steer_saturated_fraction",
    }
    assert [set(turn) for turn in m["per_turn"]] == [total | {"turn", "complete"}] * 2


def test_every_metric_has_a_unique_name_a_unit_and_a_description() -> None:
    columns = [column for metric in METRICS for column in metric.columns]
    assert len({column.name for column in columns}) == len(columns)
    assert all(column.unit and len(column.description) > 5 for column in columns)


RICH = {
    **{"plant.kind": "bicycle", "path.kind": "swaths", "path.start_offset_m": 0.5, "duration_s": 4.0},
    "fault": [{"kind": "gnss_loss", "start_s": 1.0}],
}


@pytest.fixture(scope="module")
def rich_log() -> Any:
    """Return a run in which most metrics are defined."""
    return run(load_scenario("figure_eight", RICH))


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: type(metric).__name__)
def test_every_metric_returns_its_declared_columns_as_json_values(metric: Metric, rich_log: Any) -> None:
    for log in (rich_log, FakeLog(Line(), [])):
        if len(log.column("t")) or type(metric).__module__.startswith("agrobot_mj."):
            values = metric.evaluate(RunView(log))
            json.dumps(values, allow_nan=False)
            flat = {f"{name}.{key}" for name, value in values.items() if isinstance(value, dict) for key in value}
            flat |= {name for name, value in values.items() if not isinstance(value, dict)}
            assert flat <= {column.name for column in metric.columns}


@pytest.mark.parametrize("values", [None, 1.0, {"unheard_of": 1.0}])
def test_metric_with_an_invalid_return_value_is_reported(monkeypatch: pytest.MonkeyPatch, values: Any) -> None:
    monkeypatch.setattr(type(METRICS[0]), "evaluate", lambda self, view: values)
    with pytest.raises(ScenarioError, match=r"metric progress: evaluate must return a dict of progress, got "):
        metrics(four_ticks())


def test_run_that_ends_early_has_no_metrics_for_unreached_laps() -> None:
    path = FigureEight(turns=3)
    half_way = FakeLog(path, np.arange(0, 1.5 * path.turn_s, 0.05), e_lateral=1.0, tau_n=0.1)
    m = metrics(half_way)
    assert [(turn["turn"], turn["complete"]) for turn in m["per_turn"]] == [(1, True), (2, False)]
    assert m["nn_share"] == [1.0, 1.0]


def test_last_lap_is_complete_if_the_last_tick_is_just_before_its_end() -> None:
    path = FigureEight()
    m = metrics(FakeLog(path, np.arange(0, path.duration_s, 0.05)))
    assert [turn["complete"] for turn in m["per_turn"]] == [True, True]
    one = metrics(FakeLog(path, np.arange(0, path.turn_s, 0.05)))
    assert len(one["per_turn"]) == len(one["nn_share"]) == 1


def test_metrics_ignore_missing_values_and_are_none_without_values() -> None:
    lateral, x = [1, np.nan, np.inf, np.nan], [0, np.nan, np.inf, 1e300]
    m = metrics(four_ticks(e_lateral=lateral, e_yaw_rate=np.nan, x=x))
    assert m["lateral_mse"] == 1
    assert m["yaw_rate_error_rms"] is None
    assert m["per_turn"][1]["lateral_abs_p95"] is None
    assert metrics(four_ticks(e_lateral=1e200))["lateral_mse"] is None
    json.loads(json.dumps(m, allow_nan=False))


@pytest.mark.parametrize("statistic", [mean, rms, mean_magnitude, abs_p95])
def test_statistics_of_too_few_values_are_none(statistic: Any) -> None:
    few = np.concatenate((np.ones(LEAST - 1), [np.nan, np.inf]))
    assert statistic(few) is None
    assert statistic(np.append(few, 1.0)) == pytest.approx(1.0)


def test_run_stopped_at_its_start_has_no_error_metrics() -> None:
    m = metrics(FakeLog(FigureEight(), np.arange(LEAST - 1) * 0.05, x=0.3, e_lateral=0.01))
    assert [m[name] for name in ("lateral_rms", "lateral_abs_p95", "xte_rms", "xte_abs_max")] == [None] * 4
    assert m["progress"] < 0.01


def test_run_without_ticks_has_no_metric_values() -> None:
    m = metrics(FakeLog(Line(), []), outcome="aborted")
    assert m["lateral_rms"] is None
    assert m["per_turn"] == m["nn_share"] == []
    json.dumps(m, allow_nan=False)


def test_error_metrics_can_be_limited_to_a_time_window() -> None:
    log = four_ticks(e_lateral=[7, 1, 2, 3])
    assert errors(log, start_s=0)["lateral_mse"] == pytest.approx(14 / 3)
    assert errors(log, start_s=1, end_s=1.5)["lateral_mse"] == 4
    assert errors(log)["lateral_mse"] == metrics(log)["lateral_mse"]


@pytest.mark.parametrize(
    "path", [Line(heading_deg=30), Circle(), Circle(direction="right", radius_m=2), FigureEight()], ids=repr
)
def test_cross_track_error_equals_the_path_distance_to_a_millimetre(path: Any) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0, path.duration_s, 0.05)
    ahead, left = rng.uniform(-2, 2, len(t)), rng.uniform(-1.5, 1.5, len(t))
    x, y = points_beside(path, t, ahead, left)
    assert cross_track(path, t, x, y) == pytest.approx(left, abs=1e-3)


def test_cross_track_error_uses_the_driven_branch_at_a_crossing() -> None:
    path = FigureEight()
    t = np.linspace(path.turn_s / 2 - 8, path.turn_s / 2 + 8, 200)
    x, y = points_beside(path, t, -5.0, 3.0)
    assert cross_track(path, t, x, y) == pytest.approx(3.0, abs=1e-3)


def test_cross_track_error_on_a_circle_equals_the_radial_offset() -> None:
    path, t = Circle(radius_m=5, direction="left"), np.array([0.0, 3.0])
    assert cross_track(path, t, np.array([0.0, 3.1]), np.array([-0.3, 1.0])) == pytest.approx(
        [-0.3, 5 - np.hypot(3.1, 4.0)], abs=1e-9
    )


def test_maximum_error_includes_an_error_of_a_single_tick() -> None:
    t = np.arange(0, 10, 0.05)
    y = np.where(t == t[70], -0.7, 0.1)
    assert metrics(FakeLog(Line(speed_m_s=1), t, x=t, y=y))["xte_abs_max"] == pytest.approx(0.7)


def test_lag_behind_the_reference_changes_only_the_longitudinal_error() -> None:
    path = Line(speed_m_s=1)
    t = np.arange(0, 10, 0.05)
    m = metrics(FakeLog(path, t, x=t - 2, y=0.1, e_longitudinal=2, e_lateral=0.1))
    assert (m["xte_rms"], m["xte_abs_p95"], m["xte_abs_max"]) == pytest.approx((0.1, 0.1, 0.1))
    assert m["longitudinal_rms"] == pytest.approx(2)
    assert m["per_turn"][0]["xte_rms"] == pytest.approx(0.1)


def test_run_in_is_excluded_from_lap_metrics() -> None:
    path = FigureEight()
    t = np.arange(0.0, path.duration_s, 0.05)
    early = t < path.turns_s[0][0]
    lateral = np.where(early, 7.0, 1.0)
    m = metrics(FakeLog(path, t, e_lateral=lateral))
    assert [turn["lateral_mse"] for turn in m["per_turn"]] == pytest.approx([1.0, 1.0])
    assert m["lateral_mse"] == pytest.approx(np.mean(lateral**2))


def test_lap_counts_as_complete_after_99_percent_of_its_length() -> None:
    assert [turn["complete"] for turn in metrics(four_ticks())["per_turn"]] == [True, True]
    circle = Circle(radius_m=1 / (2 * np.pi), speed_m_s=1, turns=2, ramp_s=0)
    for end, complete in ((1.985, False), (1.995, True)):
        log = FakeLog(circle, [0.0, 1.0, 1.5, end])
        assert [turn["complete"] for turn in metrics(log)["per_turn"]] == [True, complete]


def test_run_on_a_path_with_field_passes_has_pass_to_pass_metrics() -> None:
    field = Swaths(length_m=30.0, run_in_m=5.0, swath_m=2.0, count=3)
    t = np.arange(0.0, field.duration_s, 0.05)
    x, y = points_beside(field, t, 0.0, 0.12)
    found = metrics(FakeLog(field, t, x=x, y=y))["iso_12188_2_style"]
    assert found["pass_xte_abs_p95_m"] == pytest.approx(0.12, abs=1e-3)
    assert [one["xte_mean"] for one in found["per_pass"]] == pytest.approx([0.12] * 3, abs=1e-3)
    # 12 cm to the left of each pass's own direction: swaths too wide and too narrow in turn
    assert found["pass_to_pass_p95_m"] == pytest.approx(0.24, abs=2e-3)
