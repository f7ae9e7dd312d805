"""How far a tractor moves while its brake holds it."""

from typing import Any, ClassVar, Literal

import numpy as np

from agrobot_mj.control.pid import STOPPED_S
from agrobot_mj.core.signals import TICK_S, Column
from agrobot_mj.metrics.base import Metric, RunView

LEAST_M = 0.001
"""Drift from which a run says that its parked tractor moved [m]. Assumed value: three times what whole runs measure."""


class BrakedDrift(Metric):
    """How far the tractor moved while its brake was applied."""

    kind: Literal["braked_drift"] = "braked_drift"
    columns: ClassVar = (
        Column("braked_drift_m", "m", f"largest distance moved under the brake, from {STOPPED_S:g} s on; or null"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Metric over every time for which the brake stays applied."""
        braked, place = view.column("brake") > 0.0, np.column_stack([view.column("x"), view.column("y")])
        changes = np.flatnonzero(np.diff(braked, prepend=False, append=False))
        spells = [place[begin + round(STOPPED_S / TICK_S) : end] for begin, end in changes.reshape(-1, 2)]
        drifts = [float(np.hypot(*(spell - spell[0]).T).max()) for spell in spells if len(spell)]
        return {"braked_drift_m": max(drifts, default=None)}


def drift_text(metrics: dict[str, Any]) -> str:
    """What a run says of a parked tractor that moved; empty for one that stood."""
    drift = metrics.get("braked_drift_m") or 0.0
    return f"moved {1e3 * drift:.1f} mm while its brake was applied" if drift > LEAST_M else ""
