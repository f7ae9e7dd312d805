"""Local plane on the Earth: conversion of metres east and north of an origin to latitude and longitude, and back.

Metres per degree are truncated series for the WGS84 ellipsoid: latitude at the origin, longitude at the latitude of the
point, as in guidance programs for farm machines. East follows the parallel, so the plane differs from a tangent plane
by 24 mm at 500 m east of an origin at 51 degrees north. Host and tractor use the same plane.
"""

from math import cos, radians
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.contracts import check_argument
from agrobot_mj.core.signals import Array


class _Place(NamedTuple):
    latitude: float
    """Latitude, north positive [deg]."""
    longitude: float
    """Longitude, east positive [deg]."""


class Origin(_Place):
    """Geographic position of x = y = 0."""

    __slots__ = ()

    def __new__(cls, latitude: float, longitude: float) -> "Origin":
        """Raise TypeError naming the argument if a value is not a number."""
        for name, value in (("latitude", latitude), ("longitude", longitude)):
            check_argument(name, value, hasattr(value, "__float__"), "a number")  # text does not have it
        return super().__new__(cls, latitude, longitude)


def metres_per_latitude(latitude: float) -> float:
    """Return the length of a degree of latitude at a latitude [deg] on WGS84 [m/deg]."""
    phi = radians(latitude)
    return 111132.92 - 559.82 * cos(2 * phi) + 1.175 * cos(4 * phi) - 0.0023 * cos(6 * phi)


def metres_per_longitude(latitude: float) -> float:
    """Return the length of a degree of longitude at a latitude [deg] on WGS84 [m/deg]."""
    phi = radians(latitude)
    return 111412.84 * cos(phi) - 93.5 * cos(3 * phi) + 0.118 * cos(5 * phi)


def to_geodetic(origin: Origin, east: float, north: float) -> tuple[float, float]:
    """Return latitude and longitude [deg] of a point [m]."""
    latitude = origin.latitude + north / metres_per_latitude(origin.latitude)
    return latitude, origin.longitude + east / metres_per_longitude(latitude)


def to_local(origin: Origin, latitude: float, longitude: float) -> tuple[float, float]:
    """Return east and north [m] of a latitude and longitude [deg]."""
    north = (latitude - origin.latitude) * metres_per_latitude(origin.latitude)
    return (longitude - origin.longitude) * metres_per_longitude(latitude), north


def local_points(origin: Origin, latitude: Array, longitude: Array) -> Array:
    """Return east and north of points, shape (n, 2) [m], from latitudes and longitudes (n,) [deg]."""
    return np.array([to_local(origin, *pair) for pair in zip(latitude.tolist(), longitude.tolist(), strict=True)])
