"""The local plane that hosts and tractor share, under the name by which the links know it: `core/geodesy.py`."""

from agrobot_mj.core.geodesy import Origin, metres_per_latitude, metres_per_longitude, to_geodetic, to_local

__all__ = ["Origin", "metres_per_latitude", "metres_per_longitude", "to_geodetic", "to_local"]
