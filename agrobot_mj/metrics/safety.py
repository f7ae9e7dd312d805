"""Consequences of a fault, such as the delay of the stop, the distance from the path, and the maximum overspeed."""

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from agrobot_mj.control.pid import STOPPED_S
from agrobot_mj.control.supervisor import Mode
from agrobot_mj.core.signals import TICK_S, Array, Column
from agrobot_mj.metrics.base import Metric, RunView

OFF_M = 1.0  # Distance from the path above which the tractor has left the path [m]
SLOWEST_M_S = 0.5  # Minimum divisor of `safety.overspeed`, which is a speed command [m/s]
MEMORY = 40
"""Number of recent ticks [-] whose maximum speed command is compared with the speed: a stopping time of 2 s."""


class Safety(Metric):
    """Consequences of a fault in a run with a supervisor."""

    kind: Literal["safety"] = "safety"
    columns: ClassVar = (
        Column("safety.stop_s", "s", "time from the first fault to the beginning of the stop; null without a stop"),
        Column(
            "safety.overspeed",
            "-",
            "maximum speed after the first fault divided by the maximum command of the last 2 s",
        ),
        Column("safety.offset_max", "m", "maximum distance from the path after the first fault"),
        Column("safety.offset_end", "m", "distance from the path at the end"),
        Column("safety.off_s", "s", f"time from the first tick more than {OFF_M:g} m from the path to the end"),
        Column("safety.speed_end", "m/s", "speed at the end"),
        Column("safety.way", "m", "distance driven from the first fault to the end"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the metrics of the time after the first fault, or an empty dict without a fault or a supervisor."""
        faulty = np.flatnonzero(view.column("faults_active") > 0)
        state = view.reported_samples("supervisor_state")
        if state is None or not faulty.size:
            return {}
        first, stops = int(faulty[0]), np.flatnonzero(state == Mode.STOPPING)
        speed, commanded = (np.abs(view.column(name)) for name in ("speed", "speed_ref"))
        offset = np.abs(view.cg_on_path.offset[first:])
        off = np.flatnonzero(offset > OFF_M)
        return {
            "safety": {
                "stop_s": float(stops[0] - first) * TICK_S if stops.size else None,
                "overspeed": float((speed / _recent(commanded))[first:].max()),
                "offset_max": float(np.nanmax(offset, initial=0.0)),
                "offset_end": float(offset[-1]),
                "off_s": float(len(offset) - off[0]) * TICK_S if off.size else 0.0,
                "speed_end": float(speed[-1]),
                "way": float(speed[first:].sum()) * TICK_S,
            }
        }


def _recent(commanded: Array) -> Array:
    """Return the maximum speed command of the last `MEMORY` ticks [m/s], at least `SLOWEST_M_S`, shape (ticks,)."""
    before = np.full(MEMORY - 1, SLOWEST_M_S)
    found: Array = sliding_window_view(np.concatenate((before, commanded)), MEMORY).max(axis=1)
    return np.maximum(found, SLOWEST_M_S)


LEAST_M = 0.001
"""Drift of a parked tractor above which the drift is reported [m]. Assumed value: three times the normal drift."""


class BrakedDrift(Metric):
    """Drift of the tractor while the brake was applied."""

    kind: Literal["braked_drift"] = "braked_drift"
    columns: ClassVar = (
        Column("braked_drift_m", "m", f"maximum distance moved after {STOPPED_S:g} s with the brake applied; or null"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the maximum drift while the brake was applied, excluding the first `STOPPED_S` of each brake interval.

        The drift is None if the brake was never applied for more than `STOPPED_S`.
        """
        braked, place = view.column("brake") > 0.0, np.column_stack([view.column("x"), view.column("y")])
        changes = np.flatnonzero(np.diff(braked, prepend=False, append=False))
        spells = [place[begin + round(STOPPED_S / TICK_S) : end] for begin, end in changes.reshape(-1, 2)]
        drifts = [float(np.hypot(*(spell - spell[0]).T).max()) for spell in spells if len(spell)]
        return {"braked_drift_m": max(drifts, default=None)}


def drift_text(metrics: dict[str, Any]) -> str:
    """Return a message about the drift of a parked tractor, or an empty string for a drift of at most LEAST_M."""
    drift = metrics.get("braked_drift_m") or 0.0
    return f"moved {1e3 * drift:.1f} mm while its brake was applied" if drift > LEAST_M else ""
