"""Where the implement works, relative to the tractor's path: what the crop sees of the guidance."""

from typing import Any

from agrobot_mj.metrics.base import RunView, abs_p95, mean, rms


def implement(view: RunView) -> dict[str, Any]:
    """Cross-track error of the implement, left positive [m], largest angle at the hitch [rad], mean pull [N].

    Empty for a tractor without one.
    """
    try:
        offset = view.beside_path("implement_x", "implement_y").offset
    except (KeyError, ValueError):  # no such column
        return {}
    return {
        "implement_xte_rms": rms(offset),
        "implement_xte_abs_p95": abs_p95(offset),
        "implement_xte_mean": mean(offset),
        "hitch_angle_abs_p95": abs_p95(view.column("hitch_angle")),
        "hitch_pull_mean": mean(view.column("hitch_pull")),
    }
