"""Numbers from a finished run: pure functions of its log. `METRICS` is the registry of the family."""

from typing import Any

from agrobot_mj.metrics.acquisition import acquisition
from agrobot_mj.metrics.base import LogLike, RunView
from agrobot_mj.metrics.consistency import consistency, saturation
from agrobot_mj.metrics.implement import implement
from agrobot_mj.metrics.network import nn_share
from agrobot_mj.metrics.passes import passes
from agrobot_mj.metrics.progress import progress, progress_of
from agrobot_mj.metrics.safety import safety
from agrobot_mj.metrics.tracking import errors, tracking

METRICS = (
    progress,
    tracking,
    acquisition,
    nn_share,
    consistency,
    saturation,
    passes,
    implement,
    safety,
)
"""Every metric, in the order of metrics.json."""


def metrics(log: LogLike, outcome: str | None = None) -> dict[str, Any]:
    """All metrics of a run, ready for JSON, with `outcome` in front if it is given."""
    view, found = RunView(log), {} if outcome is None else {"outcome": outcome}
    for metric in METRICS:
        found |= metric(view)
    return found


__all__ = ["METRICS", "LogLike", "RunView", "errors", "metrics", "progress_of"]
