"""Parts of the cross-track error: estimator and guidance, and the steering error inside the latter.

    true CG - path = (true CG - estimated CG) + (estimated CG - path)

Each difference is taken across the path, left positive, in one frame: the path's osculating circle at the point nearest
to the true CG. So the parts add up to the cross-track error in every tick. Root mean squares add up only where the
parts are not correlated, and two large parts of opposite sign may hide each other.

The actuator is part of the guidance loop, whose commands answer what the wheels do. Its share in metres is the response
of that loop to the steering error and depends on the gains of the law; without a law the kinematic model integrates it
twice and grows without bound. Therefore the actuator is judged by the steering error itself: wheel angle less the
command one tick earlier, an angle.
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
    """True minus estimated CG, across the path."""
    guidance: Array
    """Estimated CG relative to the path: the error at the input of the law."""


def parts_of(view: RunView) -> ErrorParts:
    """Return the parts of a run; their sum is the cross-track error."""
    beside, x, y = view.cg_on_path, view.column("x_hat"), view.column("y_hat")
    guidance = beside.offset_of(x, y)
    apart = np.hypot(x - view.column("x"), y - view.column("y")) > NEAR_M
    if apart.any():
        guidance[apart] = view.beside_path("x_hat", "y_hat").offset[apart]
    return ErrorParts(beside.offset - guidance, guidance)


class Attribution(Metric):
    """Parts of the cross-track error: estimator, guidance, and the steering error."""

    kind: Literal["attribution"] = "attribution"
    columns: ClassVar = (
        Column("xte_estimator_rms", "m", "part of the cross-track error from the estimator: true less estimated CG"),
        Column("xte_guidance_rms", "m", "part of the cross-track error from the guidance: estimated CG from the path"),
        Column("steer_error_rms", "rad", "wheel angle less the commanded angle of the tick before, root mean square"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return root mean squares over the run."""
        parts = parts_of(view)
        return {
            "xte_estimator_rms": rms(parts.estimator),
            "xte_guidance_rms": rms(parts.guidance),
            "steer_error_rms": rms(view.column("steer")[1:] - view.column("steer_ref")[:-1]),
        }
