"""Tracking errors of a run and of each turn of its path.

`lateral_*` and `longitudinal_*` are the time-based errors of the paper. `xte_*` is the cross-track error, the distance
of the CG from the path independent of time (`crosstrack`). A turn contains the rows with start < t <= end; the first
turn also contains its start. Turns that the run did not reach are omitted. The turn in which the run ended is evaluated
up to the end, and is not `complete`.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, ClassVar, Literal

import numpy as np

from agrobot_mj.core.signals import Array, Column
from agrobot_mj.metrics.base import LogLike, Metric, RunView, abs_max, abs_p95, mean, rms, rows_until

COMPLETE = 0.99
"""Minimum fraction of a complete turn that the run must cover."""


class Tracking(Metric):
    """Tracking errors of the complete run and of each turn."""

    kind: Literal["tracking"] = "tracking"
    columns: ClassVar = (
        Column("lateral_mse", "m2", "mean square of the time-based lateral error"),
        Column("lateral_rms", "m", "root mean square of the time-based lateral error"),
        Column("lateral_abs_p95", "m", "95th percentile of the magnitude of the time-based lateral error"),
        Column("longitudinal_rms", "m", "root mean square of the time-based longitudinal error"),
        Column("xte_rms", "m", "root mean square of the cross-track error, the distance of the CG from the path"),
        Column("xte_abs_p95", "m", "95th percentile of the magnitude of the cross-track error"),
        Column("xte_abs_max", "m", "maximum magnitude of the cross-track error"),
        Column(
            "yaw_rate_error_rms", "rad/s", "root mean square of the yaw-rate reference minus the estimated yaw rate"
        ),
        Column("per_turn", "-", "list: the errors of each `turn` that was reached, and whether the turn is `complete`"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the tracking errors over the complete run and over each turn."""
        t, ends, found = view.column("t")[-1:], view.path.turns_s, _errors(view, [slice(None), *view.turns])
        turns = [{"turn": k + 1, "complete": _covers(t, *ends[k]), **of_turn} for k, of_turn in enumerate(found[1:])]
        return {**found[0], "per_turn": turns}


def errors(log: LogLike, start_s: float = -np.inf, end_s: float = np.inf) -> dict[str, float | None]:
    """Return the tracking errors over the rows with start_s < t <= end_s [s]."""
    view = RunView(log)
    return _errors(view, [slice(*rows_until(view.column("t"), (start_s, end_s)))])[0]


def _errors(view: RunView, choices: Sequence[slice]) -> list[dict[str, float | None]]:
    found: list[dict[str, float | None]] = [{} for _ in choices]
    for names, values in _columns(view):
        for name, statistic in names.items():
            for of_choice, rows in zip(found, choices, strict=True):
                of_choice[name] = statistic(values[rows])
    return found


def _columns(view: RunView) -> Iterator[tuple[dict[str, Callable[[Array], float | None]], Array]]:
    """Yield the values of each error, and its statistics by metric name."""
    lateral: dict[str, Callable[[Array], float | None]] = {
        "lateral_mse": partial(mean, power=2),
        "lateral_rms": rms,
        "lateral_abs_p95": abs_p95,
    }
    yield lateral, view.column("e_lateral")
    yield {"longitudinal_rms": rms}, view.column("e_longitudinal")
    yield {"xte_rms": rms, "xte_abs_p95": abs_p95, "xte_abs_max": abs_max}, view.cg_on_path.offset
    yield {"yaw_rate_error_rms": rms}, view.column("e_yaw_rate")


def _covers(t: Array, start: float, end: float) -> bool:
    return bool(t[-1] - start >= COMPLETE * (end - start))
