"""Direction and curvature of swaths along the contour lines of a field."""

from math import hypot, pi

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.fields.planner.swaths import SwathFrame
from agrobot_mj.terrain.grid import Ground, heights

STATIONS = 40  # Number of points in each direction of the field at which the height is evaluated
LEVEL = 1e-3  # Mean gradient below which a field has no contour direction [-]
STRAIGHT_RAD = 0.02  # Change of direction across a field below which its contour lines count as straight [rad]
TIGHTEST_M = 20.0  # Minimum radius of swaths [m]. Assumed value: followed at working speed by all machines.


def contour_frame(area: BaseGeometry, ground: Ground) -> SwathFrame:
    """Return the coordinate frame of swaths along the contour lines of a field.

    A quadratic surface is fitted to the heights. Its contour line through the centroid defines the direction and
    curvature of the swaths. Swaths are straight and perpendicular to the mean gradient if the contour lines are nearly
    straight, or if arcs would be tighter than `TIGHTEST_M`. Raise `ScenarioError` for a level field.
    """
    west, south, east, north = area.bounds
    x, y = (
        grid.ravel() for grid in np.meshgrid(np.linspace(west, east, STATIONS), np.linspace(south, north, STATIONS))
    )
    inside = shapely.contains_xy(area, x, y)
    z, middle = heights(ground, x[inside], y[inside]), area.centroid
    x, y = x[inside] - middle.x, y[inside] - middle.y
    terms = np.column_stack([x, y, np.ones_like(x), x * x / 2, x * y, y * y / 2])
    slope_x, slope_y, *_ = np.linalg.lstsq(terms[:, :3], z, rcond=None)[0].tolist()
    if hypot(slope_x, slope_y) < LEVEL:
        raise ScenarioError("--along contours: the field is level; set a slope or height map with --set terrain.kind")
    straight = SwathFrame(float(np.arctan2(slope_y, slope_x) + pi / 2) % pi)
    gx, gy, _, xx, xy, yy = np.linalg.lstsq(terms, z, rcond=None)[0].tolist()
    if (gradient := hypot(gx, gy)) < LEVEL:
        return straight
    curvature = -(xx * gy**2 - 2 * xy * gx * gy + yy * gx**2) / gradient**3
    if abs(curvature) * hypot(east - west, north - south) < STRAIGHT_RAD:
        return straight
    frame = SwathFrame(float(np.arctan2(gy, gx) - pi / 2), float(curvature), middle.x, middle.y)
    return frame if area.convex_hull.distance(shapely.Point(frame.centre)) > TIGHTEST_M else straight
