"""Pass-to-pass accuracy for artificial tracks."""

import json
from typing import Any

import numpy as np
import pytest

from agrobot_mj.metrics.base import LEAST
from agrobot_mj.metrics.crosstrack import track
from agrobot_mj.metrics.passes import Passed, pass_to_pass
from agrobot_mj.paths import Contour, Swaths

SMALL: Any = {"length_m": 50.0, "run_in_m": 10.0, "swath_m": 2.0}
FIELDS = [
    Swaths(**SMALL),
    Swaths(**SMALL, first_turn="right", heading_deg=130, start_x_m=4),
    Swaths(**SMALL, turn="u", count=9),
    Contour(**SMALL, uphill_deg=-30, first_uphill="right"),
]


def judged(path: Any, offset: Any, share: float = 1.0) -> dict[str, Any]:
    """Return the metrics of a tractor that is `offset(number, along)` [m] to the left of the first pass's direction.

    `number` counts the passes. `along` is the distance along the first pass [m]. `share` is the simulated fraction.
    """
    t = np.arange(0, share * path.duration_s, 0.05)
    r = np.array([path.at(s) for s in t.tolist()])
    yaw = path.at(0).yaw
    along = np.cos(yaw) * (r[:, 0] - r[0, 0]) + np.sin(yaw) * (r[:, 1] - r[0, 1])
    number = np.searchsorted([end for _, end in path.passes_s], t)
    left = np.array([offset(k, a) for k, a in zip(number.tolist(), along.tolist(), strict=True)])
    x, y = r[:, 0] - left * np.sin(yaw), r[:, 1] + left * np.cos(yaw)
    return pass_to_pass(path, track(path, t, x, y).time, x, y)


@pytest.mark.parametrize("path", FIELDS, ids=repr)
def test_run_exactly_on_the_path_has_zero_pass_to_pass_error(path: Any) -> None:
    found = judged(path, lambda k, a: 0.0)
    assert found["label"] == "12188-2-style"
    assert found["pass_to_pass_p95_m"] == pytest.approx(0, abs=1e-6)
    assert [one["pass"] for one in found["per_pass"]] == list(range(1, path.count + 1))
    assert all(one["complete"] for one in found["per_pass"])


@pytest.mark.parametrize("path", FIELDS, ids=repr)
def test_constant_shift_of_all_passes_causes_no_pass_to_pass_error(path: Any) -> None:
    found = judged(path, lambda k, a: 0.1)
    assert found["pass_to_pass_p95_m"] == pytest.approx(0, abs=1e-6)
    assert found["pass_xte_abs_p95_m"] == pytest.approx(0.1)
    means = [one["xte_mean"] for one in found["per_pass"]]
    assert means == pytest.approx([0.1 * (-1) ** k for k in range(path.count)]), "left of the driving direction"


@pytest.mark.parametrize("path", FIELDS[:2], ids=repr)
def test_constant_left_offset_causes_overlaps_and_gaps_of_twice_the_offset(path: Any) -> None:
    found = judged(path, lambda k, a: 0.05 * (-1) ** k)
    assert found["pass_to_pass_p95_m"] == pytest.approx(0.1)
    assert abs(found["pass_to_pass_mean_m"]) == pytest.approx(0.1 / 3, rel=0.01), "too narrow, too wide, too narrow"
    assert [one["xte_mean"] for one in found["per_pass"]] == pytest.approx([0.05] * path.count, rel=0.01)
    assert [one["xte_rms"] for one in found["per_pass"]] == pytest.approx([0.05] * path.count, rel=0.01)


def test_passes_that_are_too_far_apart_have_a_positive_mean_error() -> None:
    for path in (Swaths(**SMALL), Swaths(**SMALL, turn="u", count=9)):
        lines = list(path.order)
        spread = judged(path, lambda k, a, lines=lines: 0.02 * lines[min(k, len(lines) - 1)])
        assert spread["pass_to_pass_mean_m"] == pytest.approx(0.02)
        assert spread["pass_to_pass_p95_m"] == pytest.approx(0.02)


def test_neighbouring_passes_are_compared_at_equal_distances() -> None:
    """An equal bend of all passes is not a pass-to-pass error, although the passes alternate in direction."""
    found = judged(Swaths(**SMALL), lambda k, a: 0.004 * a)
    assert found["pass_to_pass_p95_m"] == pytest.approx(0, abs=1e-4)
    assert found["pass_xte_abs_p95_m"] > 0.15


def test_run_in_section_is_excluded_from_pass_to_pass_metrics() -> None:
    found = judged(Swaths(**SMALL), lambda k, a: 0.5 if (a < 9 if k % 2 == 0 else a > 41) else 0.0)
    assert found["pass_xte_abs_p95_m"] == pytest.approx(0, abs=1e-6)


def test_pass_to_pass_p95_uses_error_magnitudes_at_equal_distances() -> None:
    """The second pass deviates on 2 m of the 30 m that are next to the first pass."""
    path = Swaths(**SMALL, count=2)
    found = judged(path, lambda k, a: -0.3 if k == 1 and 24 <= a <= 26 else 0.0)
    assert found["pass_to_pass_p95_m"] == pytest.approx(0.3)
    brief = judged(path, lambda k, a: -0.3 if k == 1 and 24 <= a <= 25 else 0.0)
    assert brief["pass_to_pass_p95_m"] < 0.3


def test_run_that_ends_early_has_no_metrics_for_the_last_passes() -> None:
    path = Swaths(**SMALL)
    half_way = judged(path, lambda k, a: 0.0, share=0.4)
    assert [one["complete"] for one in half_way["per_pass"]] == [True, False, False, False]
    assert half_way["per_pass"][3]["xte_rms"] is None
    at_once = judged(path, lambda k, a: 0.0, share=0.01)
    assert at_once["pass_to_pass_p95_m"] is None
    json.dumps([half_way, at_once], allow_nan=False)


def test_single_pass_has_no_pass_to_pass_error() -> None:
    found = judged(Swaths(**SMALL, count=1), lambda k, a: 0.1)
    assert found["pass_to_pass_p95_m"] is None
    assert found["pass_xte_abs_p95_m"] == pytest.approx(0.1)


def test_pass_with_too_few_samples_has_no_pass_to_pass_metrics() -> None:
    stations = np.arange(float(LEAST))
    some = Passed(line=0.0, direction=-1, span=50.0, stations=stations, errors=0.0 * stations + 0.2).numbers(4)
    assert (some["pass"], some["complete"]) == (4, False)
    assert (some["xte_mean"], some["xte_rms"], some["xte_abs_p95"]) == pytest.approx((-0.2, 0.2, 0.2))
    for few in (0, 1, LEAST - 1):
        none = Passed(0.0, 1, 50.0, stations[:few], stations[:few]).numbers(1)
        assert (none["xte_mean"], none["xte_rms"], none["xte_abs_p95"]) == (None, None, None)
