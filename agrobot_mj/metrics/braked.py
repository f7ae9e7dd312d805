"""Motion of a tractor while its brake is applied."""

from typing import Any, ClassVar, Literal

import numpy as np

from agrobot_mj.control.pid import STOPPED_S
from agrobot_mj.core.signals import TICK_S, Column
from agrobot_mj.metrics.base import Metric, RunView

LEAST_M = 0.001
"""Drift above which the motion of a parked tractor is reported [m]. Assumed value: three times the normal drift."""


class BrakedDrift(Metric):
    """Motion of the tractor while its brake was applied."""

    kind: Literal["braked_drift"] = "braked_drift"
    columns: ClassVar = (
        Column("braked_drift_m", "m", f"maximum distance moved after {STOPPED_S:g} s with the brake applied; or null"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the maximum drift over all intervals with the brake applied; None without such an interval."""
        braked, place = view.column("brake") > 0.0, np.column_stack([view.column("x"), view.column("y")])
        changes = np.flatnonzero(np.diff(braked, prepend=False, append=False))
        spells = [place[begin + round(STOPPED_S / TICK_S) : end] for begin, end in changes.reshape(-1, 2)]
        drifts = [float(np.hypot(*(spell - spell[0]).T).max()) for spell in spells if len(spell)]
        return {"braked_drift_m": max(drifts, default=None)}


def drift_text(metrics: dict[str, Any]) -> str:
    """Return a text about the drift of a parked tractor; empty for a drift of at most LEAST_M."""
    drift = metrics.get("braked_drift_m") or 0.0
    return f"moved {1e3 * drift:.1f} mm while its brake was applied" if drift > LEAST_M else ""
