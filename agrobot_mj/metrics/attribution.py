"""Parts of the cross-track error from the estimator and the guidance, and the steering error.

    true CG - path = (true CG - estimated CG) + (estimated CG - path)

Each difference is measured across the path, left positive, in one frame: the osculating circle of the path at the
point nearest to the true CG. The parts therefore add up to the cross-track error in every tick. Root mean
squares add up only where the parts are uncorrelated, and two large parts of opposite sign may cancel.

The actuator is inside the guidance loop. Its contribution in metres is the response of the loop to the steering error
and depends on the gains of the law; without a law the kinematic model would integrate the steering error twice.
The metric of the actuator is therefore an angle, the steering error: wheel angle minus the command one tick earlier.
"""

from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array, Column
from agrobot_mj.metrics.base import Metric, RunView, rms

NEAR_M = 0.5
"""Maximum distance between true and estimated CG for which one osculating circle is used [m]. Assumed value: ten
samples of the route."""


class ErrorParts(NamedTuple):
    """Parts of the cross-track error, each of shape (ticks,), left positive [m]."""

    estimator: Array
    """Position of the true CG minus that of the estimated CG, across the path [m]."""
    guidance: Array
    """Offset of the estimated CG from the path, the input error of the law [m]."""


def parts_of(view: RunView) -> ErrorParts:
    """Return the parts of the cross-track error of a run; their sum is the cross-track error."""
    beside, x, y = view.cg_on_path, view.column("x_hat"), view.column("y_hat")
    guidance = beside.offset_of(x, y)
    apart = np.hypot(x - view.column("x"), y - view.column("y")) > NEAR_M
    if apart.any():
        guidance[apart] = view.beside_path("x_hat", "y_hat").offset[apart]
    return ErrorParts(beside.offset - guidance, guidance)


class Attribution(Metric):
    """Parts of the cross-track error from estimator and guidance, and the steering error."""

    kind: Literal["attribution"] = "attribution"
    columns: ClassVar = (
        Column("xte_estimator_rms", "m", "part of the cross-track error from the estimator: true minus estimated CG"),
        Column("xte_guidance_rms", "m", "part of the cross-track error from the guidance: estimated CG from the path"),
        Column("steer_error_rms", "rad", "wheel angle minus the commanded angle one tick earlier, root mean square"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the root mean squares of the parts and of the steering error."""
        parts = parts_of(view)
        return {
            "xte_estimator_rms": rms(parts.estimator),
            "xte_guidance_rms": rms(parts.guidance),
            "steer_error_rms": rms(view.column("steer")[1:] - view.column("steer_ref")[:-1]),
        }
