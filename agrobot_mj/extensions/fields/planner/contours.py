"""Direction of the contour lines of a field."""

from math import hypot, pi

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.terrain.grid import Ground, heights

STATIONS = 40  # Number of evaluated points of the field in each direction
LEVEL = 1e-3  # Mean gradient below which a field has no contour direction [-]


def contour_direction(area: BaseGeometry, ground: Ground) -> float:
    """Return the direction perpendicular to the mean gradient of a field [rad], counter-clockwise from east.

    The mean gradient is that of the plane fitted to the heights. Raises `ScenarioError` for a level field.
    """
    west, south, east, north = area.bounds
    x, y = (
        grid.ravel() for grid in np.meshgrid(np.linspace(west, east, STATIONS), np.linspace(south, north, STATIONS))
    )
    inside = shapely.contains_xy(area, x, y)
    x, y = x[inside], y[inside]
    plane, *_ = np.linalg.lstsq(np.column_stack([x, y, np.ones_like(x)]), heights(ground, x, y), rcond=None)
    if hypot(plane[0], plane[1]) < LEVEL:
        raise ScenarioError("--along contours: the field is level; set a slope or height map with --set terrain.kind")
    return float(np.arctan2(plane[1], plane[0]) + pi / 2) % pi
