"""Tracking errors of a run and of each of its turns.

`lateral_*` and `longitudinal_*` are the time-based errors of the paper; `xte_*` is the cross-track error, the distance
of the CG from the path itself, whatever the time (`crosstrack`). A row of the log belongs to the turn with start <
t <= end (the first turn also owns its start). A run that ends early lacks the turns it did not reach; the turn in
which it ended counts as far as it went and is not `complete`.
"""

from typing import Any

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.metrics.base import LogLike, RowMask, RunView, abs_p95, mean, rms

COMPLETE = 0.99
"""Share of a turn that a run must cover for the turn to count as complete."""


def tracking(view: RunView) -> dict[str, Any]:
    """Tracking errors of the complete run, and `per_turn`."""
    t, ends, xte = view.column("t"), view.path.turns_s, view.beside.offset
    turns = [
        {"turn": k + 1, "complete": _covers(t, *ends[k]), **_errors(view, xte, rows)}
        for k, rows in enumerate(view.turns)
    ]
    return {**_errors(view, xte, np.ones(len(xte), dtype=bool)), "per_turn": turns}


def errors(log: LogLike, start_s: float = -np.inf, end_s: float = np.inf) -> dict[str, float | None]:
    """The tracking errors over the rows with start_s < t <= end_s [s]."""
    view = RunView(log)
    t = view.column("t")
    return _errors(view, view.beside.offset, (t > start_s) & (t <= end_s))


def _errors(view: RunView, xte: Array, rows: RowMask) -> dict[str, float | None]:
    lateral, longitudinal = view.column("e_lateral")[rows], view.column("e_longitudinal")[rows]
    return {
        "lateral_mse": mean(lateral, 2),
        "lateral_rms": rms(lateral),
        "lateral_abs_p95": abs_p95(lateral),
        "longitudinal_rms": rms(longitudinal),
        "xte_rms": rms(xte[rows]),
        "xte_abs_p95": abs_p95(xte[rows]),
        "yaw_rate_error_rms": rms(view.column("e_yaw_rate")[rows]),
    }


def _covers(t: Array, start: float, end: float) -> bool:
    return bool(t[-1] - start >= COMPLETE * (end - start))
