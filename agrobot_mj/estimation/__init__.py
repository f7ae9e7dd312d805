"""State estimation: velocity Kalman filter and pose extended Kalman filter, the only users of filterpy."""

from agrobot_mj.estimation.estimator import Estimator, EstimatorState

__all__ = ["Estimator", "EstimatorState"]
