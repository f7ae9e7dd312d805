"""Share of the network, or of the integral that stands in for it, in the steering command."""

from typing import Any

import numpy as np

from agrobot_mj.metrics.base import RowMask, RunView, mean


def nn_share(view: RunView) -> dict[str, Any]:
    """`nn_share`: one value per turn, mean|tau_n| / (mean|tau_c| + mean|tau_n|), 0 without a network."""
    return {"nn_share": [_share(view, rows) for rows in view.turns]}


def _share(view: RunView, rows: RowMask) -> float:
    tau_c = mean(np.abs(view.column("tau_c")[rows])) or 0.0
    tau_n = mean(np.abs(view.column("tau_n")[rows])) or 0.0
    return tau_n / (tau_c + tau_n) if tau_n else 0.0
