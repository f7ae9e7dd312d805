"""State estimators, based on Kalman filters of velocity and pose. Only this package imports filterpy."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.estimation.base import StateEstimator
from agrobot_mj.estimation.ekf import Ekf
from agrobot_mj.estimation.ekf_bias import EkfBias
from agrobot_mj.estimation.ekf_full import EkfFull
from agrobot_mj.estimation.pose_estimator import EstimatorState
from agrobot_mj.estimation.ukf import Ukf

Estimator = Annotated[
    Ekf
    | EkfBias
    | EkfFull
    | Ukf,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = ["Ekf", "EkfBias", "EkfFull", "Estimator", "EstimatorState", "StateEstimator", "Ukf"]
