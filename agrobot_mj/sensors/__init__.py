"""Sensors, which compute a measurement from the true state once per tick."""

from agrobot_mj.sensors.base import Sensor
from agrobot_mj.sensors.canopy import Canopy
from agrobot_mj.sensors.dual_antenna import DualAntenna
from agrobot_mj.sensors.gnss import Gnss
from agrobot_mj.sensors.gyro import Gyro
from agrobot_mj.sensors.implement_gnss import ImplementGnss
from agrobot_mj.sensors.imu import Imu
from agrobot_mj.sensors.potentiometer import PedalPotentiometer, Potentiometer, SteeringPotentiometer
from agrobot_mj.sensors.speed import RadarSpeed, WheelSpeed
from agrobot_mj.sensors.suite import Sensors, SensorState, Suite

__all__ = [
    "Canopy",
    "DualAntenna",
    "Gnss",
    "Gyro",
    "ImplementGnss",
    "Imu",
    "PedalPotentiometer",
    "Potentiometer",
    "RadarSpeed",
    "Sensor",
    "SensorState",
    "Sensors",
    "SteeringPotentiometer",
    "Suite",
    "WheelSpeed",
]
