"""Contributions of the estimator and of the guidance to the cross-track error, and the steering error.

    true CG - path = (true CG - estimated CG) + (estimated CG - path)

Each difference is measured across the path, positive to the left. All differences use one osculating circle of the
path, at the point nearest to the true CG. Both contributions therefore add up to the cross-track error in every tick.
Their mean squares add up only if the contributions are uncorrelated. Large contributions of opposite sign may cancel.

The actuator is inside the guidance loop, and its effect on the cross-track error [m] depends on the guidance gains. The
metric of the actuator is therefore the steering error: wheel angle minus the command one tick earlier.
"""

from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array, Column
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.metrics.base import Metric, RunView, mean, rms

NEAR_M = 0.5  # Maximum distance between true and estimated CG for a shared osculating circle [m]. Assumed value.


class ErrorParts(NamedTuple):
    """Contributions to the cross-track error [m], each of shape (ticks,), positive to the left."""

    estimator: Array  # Position of the true CG relative to the estimated CG, across the path [m]
    guidance: Array  # Offset of the estimated CG from the path, the input of the guidance law [m]


def parts_of(view: RunView) -> ErrorParts:
    """Return the contributions of estimator and guidance to the cross-track error of a run."""
    beside, x, y = view.cg_on_path, view.column("x_hat"), view.column("y_hat")
    guidance = beside.offset_of(x, y)
    apart = np.hypot(x - view.column("x"), y - view.column("y")) > NEAR_M
    if apart.any():
        guidance[apart] = view.beside_path("x_hat", "y_hat").offset[apart]
    return ErrorParts(beside.offset - guidance, guidance)


class Attribution(Metric):
    """Contributions of the estimator and of the guidance to the cross-track error, and the steering error."""

    kind: Literal["attribution"] = "attribution"
    columns: ClassVar = (
        Column("xte_estimator_rms", "m", "part of the cross-track error from the estimator: true minus estimated CG"),
        Column("xte_guidance_rms", "m", "part of the cross-track error from the guidance: estimated CG minus path"),
        Column("steer_error_rms", "rad", "wheel angle minus the commanded angle one tick earlier, root mean square"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the root mean squares of the estimator and guidance contributions to the cross-track error, and of the
        steering error."""
        parts = parts_of(view)
        return {
            "xte_estimator_rms": rms(parts.estimator),
            "xte_guidance_rms": rms(parts.guidance),
            "steer_error_rms": rms(view.column("steer")[1:] - view.column("steer_ref")[:-1]),
        }


SIDEWAYS_M_S2 = 0.5
"""Maximum lateral specific force at which a tick counts as straight driving on level ground [m/s2]. Assumed value: the
sideslip is then below 0.5 deg."""
MOVES_M_S = 0.3  # Minimum speed of the ticks used for `level_sideslip` [m/s]. Assumed value.
LEVEL_TICKS = 200  # Minimum number of ticks for `level_sideslip`: ten seconds. Assumed value.


class Consistency(Metric):
    """Consistency of the estimation error with its covariance, and the fraction of ticks with saturated steering."""

    kind: Literal["consistency"] = "consistency"
    columns: ClassVar = (
        Column("position_nees", "-", "mean NEES of the position, 2 if the estimator is consistent"),
        Column("position_nis", "-", "mean NIS of the position, 2 if the estimator is consistent"),
        Column("level_sideslip", "rad", "median of the estimated sideslip in straight forward motion on level ground"),
        Column("antenna_mounting", "rad", "last estimate of the mounting error of two antennas"),
        Column("steer_saturated_fraction", "-", "fraction of the ticks with the steering command at its limit"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return mean NEES and NIS, the saturated fraction, and the sideslip and mounting error if they are logged."""
        return {
            "position_nees": mean(view.column("position_nees")),
            "position_nis": mean(view.column("position_nis")),
            **_level_sideslip(view),
            **_antenna_mounting(view),
            "steer_saturated_fraction": mean(view.column("steer_saturated")),
        }


def _level_sideslip(view: RunView) -> dict[str, float | None]:
    if (sideslip := view.reported_samples("sideslip_hat")) is None:
        return {}
    speed = view.column("speed")
    sideways = speed * view.column("yaw_rate") + GRAVITY * np.sin(view.column("roll"))
    level = sideslip[(np.abs(speed) > MOVES_M_S) & (np.abs(sideways) < SIDEWAYS_M_S2) & np.isfinite(sideslip)]
    return {"level_sideslip": float(np.median(level)) if len(level) >= LEVEL_TICKS else None}


def _antenna_mounting(view: RunView) -> dict[str, float | None]:
    if (mounting := view.reported_samples("mounting_hat")) is None:
        return {}
    known = mounting[np.isfinite(mounting)]
    return {"antenna_mounting": float(known[-1]) if len(known) else None}
