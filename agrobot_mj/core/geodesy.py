"""Local plane on the Earth: conversion between east and north coordinates [m] and latitude and longitude [deg].

The length of a degree is computed from a truncated series for the WGS84 ellipsoid, as in guidance programs for farm
machines. The length of a degree of latitude is evaluated at the origin, and the length of a degree of longitude at the
latitude of the point. The east axis follows the parallel: at 51 degrees north, 500 m from the origin, the axis is 24 mm
north of a straight line.
"""

from math import cos, radians
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.contracts import check_argument
from agrobot_mj.core.signals import Array


class _Place(NamedTuple):
    latitude: float  # Latitude [deg], north positive
    longitude: float  # Longitude [deg], east positive


class Origin(_Place):
    """Geographic coordinates of the origin x = y = 0 of a local plane."""

    __slots__ = ()

    def __new__(cls, latitude: float, longitude: float) -> "Origin":
        """Create an origin. Raises TypeError with the argument name if a value is not a number."""
        for name, value in (("latitude", latitude), ("longitude", longitude)):
            check_argument(name, value, hasattr(value, "__float__"), "a number")  # a text has no __float__
        return super().__new__(cls, latitude, longitude)


def metres_per_latitude(latitude: float) -> float:
    """Return the length of one degree of latitude [m/deg] on WGS84 at a latitude [deg]."""
    phi = radians(latitude)
    return 111132.92 - 559.82 * cos(2 * phi) + 1.175 * cos(4 * phi) - 0.0023 * cos(6 * phi)


def metres_per_longitude(latitude: float) -> float:
    """Return the length of one degree of longitude [m/deg] on WGS84 at a latitude [deg]."""
    phi = radians(latitude)
    return 111412.84 * cos(phi) - 93.5 * cos(3 * phi) + 0.118 * cos(5 * phi)


def to_geodetic(origin: Origin, east: float, north: float) -> tuple[float, float]:
    """Convert distances `east` and `north` of the origin [m] to latitude and longitude [deg]."""
    latitude = origin.latitude + north / metres_per_latitude(origin.latitude)
    return latitude, origin.longitude + east / metres_per_longitude(latitude)


def to_local(origin: Origin, latitude: float, longitude: float) -> tuple[float, float]:
    """Convert latitude and longitude [deg] to distances east and north of the origin [m]."""
    north = (latitude - origin.latitude) * metres_per_latitude(origin.latitude)
    return (longitude - origin.longitude) * metres_per_longitude(latitude), north


def local_points(origin: Origin, latitude: Array, longitude: Array) -> Array:
    """Convert latitudes and longitudes (n,) [deg] to distances east and north of the origin, shape (n, 2) [m]."""
    lengths = np.array([metres_per_longitude(each) for each in latitude.tolist()])
    north = (latitude - origin.latitude) * metres_per_latitude(origin.latitude)
    return np.column_stack([(longitude - origin.longitude) * lengths, north])


def geodetic_points(origin: Origin, points: Array) -> Array:
    """Convert points (n, 2), distances east and north of the origin [m], to longitudes and latitudes (n, 2) [deg]."""
    return np.array([to_geodetic(origin, *point)[::-1] for point in points.tolist()]).reshape(-1, 2)
