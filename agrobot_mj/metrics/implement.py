"""Errors of the implement relative to the path of the tractor, and the draught force at the hitch."""

from typing import Any, ClassVar, Literal

from agrobot_mj.core.signals import Column
from agrobot_mj.metrics.base import Metric, RunView, abs_p95, mean, rms


class ImplementErrors(Metric):
    """Errors of the working point of an implement, and its draught force at the hitch."""

    kind: Literal["implement"] = "implement"
    columns: ClassVar = (
        Column("implement_xte_rms", "m", "cross-track error of the implement, root mean square"),
        Column("implement_xte_abs_p95", "m", "95th percentile of the magnitude of the implement's cross-track error"),
        Column("implement_xte_mean", "m", "mean cross-track error of the implement, left positive"),
        Column("hitch_angle_abs_p95", "rad", "95th percentile of the magnitude of the angle at the hitch"),
        Column("hitch_pull_mean", "N", "mean pull at the hitch"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the metrics of the implement; an empty dict for a tractor without implement."""
        try:
            offset = view.beside_path("implement_x", "implement_y").offset
        except (KeyError, ValueError):  # missing column
            return {}
        return {
            "implement_xte_rms": rms(offset),
            "implement_xte_abs_p95": abs_p95(offset),
            "implement_xte_mean": mean(offset),
            "hitch_angle_abs_p95": abs_p95(view.column("hitch_angle")),
            "hitch_pull_mean": mean(view.column("hitch_pull")),
        }
