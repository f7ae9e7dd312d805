"""Consistency of the estimator, and how often the steering was at its limit."""

from typing import Any

from agrobot_mj.metrics.base import RunView, mean


def consistency(view: RunView) -> dict[str, Any]:
    """Mean NEES and NIS of the position, 2 if the estimator is consistent."""
    return {
        "position_nees": mean(view.column("position_nees")),
        "position_nis": mean(view.column("position_nis")),
    }


def saturation(view: RunView) -> dict[str, Any]:
    """Share of the ticks with the steering command at its limit."""
    return {"steer_saturated_fraction": mean(view.column("steer_saturated"))}
