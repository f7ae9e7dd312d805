"""Consistency of the estimator, and the fraction of time with saturated steering."""

from typing import Any, ClassVar, Literal

import numpy as np

from agrobot_mj.core.signals import Column
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.metrics.base import Metric, RunView, mean

SIDEWAYS_M_S2 = 0.5
"""Maximum lateral specific force in straight driving on level ground [m/s2]. Assumed value: sideslip below 0.5 deg."""
MOVES_M_S = 0.3
"""Minimum speed of the ticks used for `level_sideslip` [m/s]. Assumed value."""
LEVEL_TICKS = 200
"""Minimum number of ticks for `level_sideslip`: ten seconds. Assumed value."""


class Consistency(Metric):
    """Consistency of the estimator's errors with its covariance, and the fraction of time with saturated steering."""

    kind: Literal["consistency"] = "consistency"
    columns: ClassVar = (
        Column("position_nees", "-", "mean NEES of the position, 2 if the estimator is consistent"),
        Column("position_nis", "-", "mean NIS of the position, 2 if the estimator is consistent"),
        Column("level_sideslip", "rad", "median of the estimated sideslip in straight forward motion on level ground"),
        Column("antenna_mounting", "rad", "last estimate of the mounting error of two antennas"),
        Column("steer_saturated_fraction", "-", "fraction of the ticks with the steering command at its limit"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return means over the run, with sideslip and mounting error if the estimator reports them."""
        return {
            "position_nees": mean(view.column("position_nees")),
            "position_nis": mean(view.column("position_nis")),
            **_level_sideslip(view),
            **_antenna_mounting(view),
            "steer_saturated_fraction": mean(view.column("steer_saturated")),
        }


def _level_sideslip(view: RunView) -> dict[str, float | None]:
    try:
        sideslip = view.column("sideslip_hat")
    except (KeyError, ValueError):  # missing column
        return {}
    speed = view.column("speed")
    sideways = speed * view.column("yaw_rate") + GRAVITY * np.sin(view.column("roll"))
    level = sideslip[(np.abs(speed) > MOVES_M_S) & (np.abs(sideways) < SIDEWAYS_M_S2) & np.isfinite(sideslip)]
    return {"level_sideslip": float(np.median(level)) if len(level) >= LEVEL_TICKS else None}


def _antenna_mounting(view: RunView) -> dict[str, float | None]:
    try:
        mounting = view.column("mounting_hat")
    except (KeyError, ValueError):  # missing column
        return {}
    known = mounting[np.isfinite(mounting)]
    return {"antenna_mounting": float(known[-1]) if len(known) else None}
