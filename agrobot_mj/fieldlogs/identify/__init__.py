"""Identification of a vehicle's lateral dynamics from a recording."""

from agrobot_mj.fieldlogs.identify.vehicle import identify_vehicle_command

__all__ = ["identify_vehicle_command"]
