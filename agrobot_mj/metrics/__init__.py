"""Metrics of a finished run, computed from its log. The list `METRICS` contains all metrics."""

from typing import Any

from agrobot_mj.core.contracts import one_line
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.metrics.attribution import Attribution, Consistency
from agrobot_mj.metrics.base import LogLike, Metric, RunView
from agrobot_mj.metrics.passes import PassAccuracy
from agrobot_mj.metrics.safety import BrakedDrift, Safety
from agrobot_mj.metrics.tracking import Acquisition, DrivenShare, ImplementErrors, NetworkShare, Tracking, errors

METRICS: list[Metric] = [
    DrivenShare(),
    Tracking(),
    Attribution(),
    Acquisition(),
    NetworkShare(),
    Consistency(),
    PassAccuracy(),
    ImplementErrors(),
    Safety(),
    BrakedDrift(),
]
LINKED = dict.fromkeys(("cross_track_rms", "cross_track_late_rms", "cross_track_offset"), "m")
"""Units of metrics of external guidance programs whose names do not end with a unit."""
ENDINGS = {"_ms": "ms", "_hz": "Hz", "_s": "s", "_m": "m"}  # Units of metrics, by the suffix of the metric name


def metrics(log: LogLike, outcome: str | None = None, view: RunView | None = None) -> dict[str, Any]:
    """Return all metrics of a run as JSON values by name. If `outcome` is given, it becomes the first entry."""
    view, found = view or RunView(log), {} if outcome is None else {"outcome": outcome}
    for metric in METRICS:
        values = metric.evaluate(view)
        if not (isinstance(values, dict) and values.keys() <= metric.names):
            wanted = f"a dict of {', '.join(sorted(metric.names))}"
            raise ScenarioError(f"metric {metric.kind}: evaluate must return {wanted}, got {one_line(values)}")
        found |= values
    return found


def unit_of(name: str) -> str:
    """Return the unit of the metric `name`, from its column or else from the suffix of its name; "-" if unknown."""
    known = LINKED | {column.name: column.unit for metric in METRICS for column in metric.columns}
    return known.get(name) or next((unit for end, unit in ENDINGS.items() if name.endswith(end)), "-")


__all__ = [
    "METRICS",
    "LogLike",
    "Metric",
    "RunView",
    "errors",
    "metrics",
    "unit_of",
]
