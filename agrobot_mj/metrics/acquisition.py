"""The way onto its path of a tractor that starts beside it: how long it takes, and how far it goes too far."""

from typing import Any

import numpy as np

from agrobot_mj.metrics.base import RunView

BAND_M = 0.05
"""Distance from the path within which it is reached [m]. Estimate: twice the claim of RTK guidance."""
STAYS_S = 2.0
"""Time at the end of a run in which the tractor must be within the band [s]. Estimate."""


def acquisition(view: RunView) -> dict[str, Any]:
    """`acquisition`, for a tractor that starts beside its path (`path.start_offset_m`).

    `acquired_s` is the last time outside the band, None of a tractor that is outside at the end of the run,
    `overshoot_m` the largest distance on the other side, `end_abs_max_m` the largest one at the end.
    """
    if not view.path.start_offset_m:
        return {}
    t, e = view.column("t"), view.beside.offset
    outside, late = t[np.abs(e) > BAND_M], t > t[-1] - STAYS_S
    last = float(outside[-1]) if len(outside) else 0.0
    over = float(np.fmax.reduce(-np.sign(view.path.start_offset_m) * e, initial=0.0))
    at_end = float(np.fmax.reduce(np.abs(e[late]), initial=0.0))
    acquired = None if last > t[-1] - STAYS_S else last
    return {"acquisition": {"acquired_s": acquired, "overshoot_m": over, "end_abs_max_m": at_end}}
