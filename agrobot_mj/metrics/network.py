"""Share of the network, or of the integral that stands in for it, in the steering command."""

from typing import Any

from agrobot_mj.metrics.base import RunView, mean_magnitude


def nn_share(view: RunView) -> dict[str, Any]:
    """`nn_share`: one value per turn, mean|tau_n| / (mean|tau_c| + mean|tau_n|), 0 without a network."""
    kept, learnt = _sizes(view, "tau_c"), _sizes(view, "tau_n")
    return {"nn_share": [n / (c + n) if n else 0.0 for c, n in zip(kept, learnt, strict=True)]}


def _sizes(view: RunView, name: str) -> list[float]:
    """Mean magnitude of a column in each turn."""
    values = view.chunked(name)
    return [mean_magnitude(values[rows]) or 0.0 for rows in view.turns]
