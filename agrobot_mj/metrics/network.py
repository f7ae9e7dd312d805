"""Share of the network, or of the integral that stands in for it, in the steering command."""

from typing import Any

from agrobot_mj.core.signals import Array
from agrobot_mj.metrics.base import LEAST, RunView, mean_magnitude


def nn_share(view: RunView) -> dict[str, Any]:
    """`nn_share`: one value per turn, mean|tau_n| / (mean|tau_c| + mean|tau_n|), 0 without a network.

    None for a turn of fewer than LEAST ticks.
    """
    kept, learnt = view.column("tau_c"), view.column("tau_n")
    return {"nn_share": [_share(kept[rows], learnt[rows]) for rows in view.turns]}


def _share(kept: Array, learnt: Array) -> float | None:
    """Share of what was learnt."""
    if len(kept) < LEAST:
        return None
    c, n = mean_magnitude(kept) or 0.0, mean_magnitude(learnt) or 0.0
    return n / (c + n) if n else 0.0
