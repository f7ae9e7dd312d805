"""Fraction of the steering command from the network, or from the integral that replaces the network."""

from typing import Any, ClassVar, Literal

from agrobot_mj.core.signals import Array, Column
from agrobot_mj.metrics.base import LEAST, Metric, RunView, mean_magnitude


class NetworkShare(Metric):
    """Fraction of the steering command from the network, or from the integral that replaces the network."""

    kind: Literal["nn_share"] = "nn_share"
    columns: ClassVar = (Column("nn_share", "-", "list: mean|tau_n| / (mean|tau_c| + mean|tau_n|) of each turn"),)

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return one fraction per turn: 0 without network, None for a turn with fewer than LEAST ticks."""
        kept, learnt = view.column("tau_c"), view.column("tau_n")
        return {"nn_share": [_share(kept[rows], learnt[rows]) for rows in view.turns]}


def _share(kept: Array, learnt: Array) -> float | None:
    if len(kept) < LEAST:
        return None
    c, n = mean_magnitude(kept) or 0.0, mean_magnitude(learnt) or 0.0
    return n / (c + n) if n else 0.0
