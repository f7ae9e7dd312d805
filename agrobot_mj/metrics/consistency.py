"""Consistency of the estimator, and how often the steering was at its limit."""

from typing import Any, ClassVar, Literal

from agrobot_mj.core.signals import Column
from agrobot_mj.metrics.base import Metric, RunView, mean


class Consistency(Metric):
    """Whether the estimator's errors are as large as it believes, and how often the steering was at its limit."""

    kind: Literal["consistency"] = "consistency"
    columns: ClassVar = (
        Column("position_nees", "-", "mean NEES of the position, 2 if the estimator is consistent"),
        Column("position_nis", "-", "mean NIS of the position, 2 if the estimator is consistent"),
        Column("steer_saturated_fraction", "-", "share of the ticks with the steering command at its limit"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Means over the run."""
        return {
            "position_nees": mean(view.column("position_nees")),
            "position_nis": mean(view.column("position_nis")),
            "steer_saturated_fraction": mean(view.column("steer_saturated")),
        }
