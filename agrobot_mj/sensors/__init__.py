"""The sensors: truth in, measurement out, once a tick."""

from agrobot_mj.sensors.imu import Imu, ImuState
from agrobot_mj.sensors.suite import (
    Gnss,
    GnssState,
    Gyro,
    PedalPotentiometer,
    Potentiometer,
    Sensors,
    SensorState,
)

__all__ = [
    "Gnss",
    "GnssState",
    "Gyro",
    "Imu",
    "ImuState",
    "PedalPotentiometer",
    "Potentiometer",
    "SensorState",
    "Sensors",
]
