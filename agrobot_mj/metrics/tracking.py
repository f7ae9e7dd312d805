"""Tracking errors of a run and of each lap (`turn`) of its path.

`lateral_*` and `longitudinal_*` are the time-based errors of the paper. `xte_*` is the cross-track error, the distance
of the CG from the path independent of time (see `crosstrack`).

A lap contains the rows with start < t <= end; the first lap also contains its start. Laps that the run did not reach
are omitted. The lap in which the run ended is evaluated up to the end of the run, and is `complete` from 99 % of its
duration.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, ClassVar, Literal

import numpy as np

from agrobot_mj.core.signals import Array, Column
from agrobot_mj.metrics.base import (
    LEAST,
    LogLike,
    Metric,
    RunView,
    abs_max,
    abs_p95,
    mean,
    mean_magnitude,
    rms,
    rows_until,
)

COMPLETE = 0.99  # Minimum fraction of a lap that a run must cover for the lap to be complete [-]


class Tracking(Metric):
    """Tracking errors of the complete run and of each lap."""

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
        """Return the tracking errors over the complete run and over each lap."""
        t, ends, found = view.column("t")[-1:], view.path.turns_s, _errors(view, [slice(None), *view.turns])
        turns = [{"turn": k + 1, "complete": _covers(t, *ends[k]), **of_turn} for k, of_turn in enumerate(found[1:])]
        return {**found[0], "per_turn": turns}


class DrivenShare(Metric):
    """Fraction of the path length that the tractor has driven."""

    kind: Literal["progress"] = "progress"
    columns: ClassVar = (Column("progress", "-", "driven fraction of the path length; null for a path without length"),)

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the driven fraction of the path length [-], or None for a path without length."""
        return {"progress": view.progress.share}


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
    """Yield each error signal with its statistics, as functions by metric name."""
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


class NetworkShare(Metric):
    """Fraction of the steering command due to the network, or to the integral term that replaces the network."""

    kind: Literal["nn_share"] = "nn_share"
    columns: ClassVar = (Column("nn_share", "-", "list: mean|tau_n| / (mean|tau_c| + mean|tau_n|) of each turn"),)

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the fraction of each lap [-]: 0 without a network, and None for a lap with fewer than LEAST ticks."""
        kept, learnt = view.column("tau_c"), view.column("tau_n")
        return {"nn_share": [_share(kept[rows], learnt[rows]) for rows in view.turns]}


def _share(kept: Array, learnt: Array) -> float | None:
    if len(kept) < LEAST:
        return None
    c, n = mean_magnitude(kept) or 0.0, mean_magnitude(learnt) or 0.0
    return n / (c + n) if n else 0.0


class ImplementErrors(Metric):
    """Errors of the working point of an implement, and the draught force at the hitch."""

    kind: Literal["implement"] = "implement"
    columns: ClassVar = (
        Column("implement_xte_rms", "m", "cross-track error of the implement, root mean square"),
        Column("implement_xte_abs_p95", "m", "95th percentile of the magnitude of the implement's cross-track error"),
        Column("implement_xte_mean", "m", "mean cross-track error of the implement, left positive"),
        Column("hitch_angle_abs_p95", "rad", "95th percentile of the magnitude of the angle at the hitch"),
        Column("hitch_pull_mean", "N", "mean pull at the hitch"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the metrics of the implement, or an empty dict for a tractor without an implement."""
        if view.reported_samples("implement_x") is None:
            return {}
        offset = view.beside_path("implement_x", "implement_y").offset
        return {
            "implement_xte_rms": rms(offset),
            "implement_xte_abs_p95": abs_p95(offset),
            "implement_xte_mean": mean(offset),
            "hitch_angle_abs_p95": abs_p95(view.column("hitch_angle")),
            "hitch_pull_mean": mean(view.column("hitch_pull")),
        }


BAND_M = 0.05  # Maximum distance from an acquired path [m]. Assumed value: twice the accuracy stated for RTK guidance.
HELD_S = 5.0  # Minimum time within BAND_M of an acquired path [s]. Assumed value: longer than half an oscillation.
END_S = 2.0  # Duration of the final part of the run [s], in which the maximum remaining offset is measured


class Acquisition(Metric):
    """Acquisition of the path after a start with a lateral offset (`path.start_offset_m`)."""

    kind: Literal["acquisition"] = "acquisition"
    columns: ClassVar = (
        Column(
            "acquisition.acquired_s",
            "s",
            f"first time after which the CG stays within {BAND_M:g} m for {HELD_S:g} s; or null",
        ),
        Column("acquisition.overshoot_m", "m", "maximum distance on the side of the path opposite to the start"),
        Column("acquisition.end_abs_max_m", "m", f"maximum distance from the path in the last {END_S:g} s"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the metrics of the path acquisition, or an empty dict for a path without a start offset."""
        if not view.path.start_offset_m:
            return {}
        t, e = view.column("t"), view.cg_on_path.offset
        outside = t[~(np.abs(e) <= BAND_M)]
        begins = np.append(t[0], outside)
        held = np.diff(np.append(begins, t[-1])) >= HELD_S
        over = float(np.fmax.reduce(-np.sign(view.path.start_offset_m) * e, initial=0.0))
        at_end = float(np.fmax.reduce(np.abs(e[t > t[-1] - END_S]), initial=0.0))
        acquired = float(begins[np.argmax(held)]) if held.any() else None
        return {"acquisition": {"acquired_s": acquired, "overshoot_m": over, "end_abs_max_m": at_end}}
