"""State estimation: velocity Kalman filter and extended Kalman filters of the pose, the only users of filterpy."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.estimation.base import EstimatorState
from agrobot_mj.estimation.ekf import Ekf
from agrobot_mj.estimation.ekf_bias import EkfBias

Estimator = Annotated[
    Ekf
    | EkfBias,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = ["Ekf", "EkfBias", "Estimator", "EstimatorState"]
