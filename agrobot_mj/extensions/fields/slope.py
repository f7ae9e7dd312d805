"""Slope of a field: heights on a grid inside the boundary, slope angles and their directions."""

from dataclasses import dataclass
from math import atan2, ceil, degrees, hypot
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from agrobot_mj.core.signals import Array
from agrobot_mj.terrain.grid import Ground, heights

STEP_M, MOST_STEPS = 2.0, 300
"""Minimum distance between the points at which the slope is computed [m], and maximum number of distances along each
side of the field [-]."""
COMMON = 0.5  # Minimum ratio of mean gradient to mean slope above which a field has a common direction [-]
LEVEL_DEG = 0.05  # Mean slope below which a field counts as level [deg]
POINTS = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")


@dataclass(frozen=True, eq=False)
class Relief:
    """Heights of a field at the nodes of a grid. Arrays have the shape (rows, columns), with NaN outside the field."""

    x: Array  # East coordinates of the columns [m], shape (columns,)
    y: Array  # North coordinates of the rows [m], shape (rows,)
    heights: Array  # Heights of the ground [m]
    east: Array  # Slopes to the east [-]
    north: Array  # Slopes to the north [-]
    notes: tuple[str, ...] = ()  # Sentences about the source of the heights


def relief_of(boundary: Polygon, ground: Ground, notes: tuple[str, ...] = ()) -> Relief:
    """Return the heights and slopes of the ground inside a boundary. `notes` are about the source of the heights."""
    x, y, inside = _nodes(boundary)
    found = heights(ground, *np.meshgrid(x, y))
    slopes = np.gradient(found, float(x[1] - x[0]))
    height, to_east, to_north = (np.where(inside, values, np.nan) for values in (found, slopes[1], slopes[0]))
    return Relief(x, y, height, to_east, to_north, notes)


def farthest_point(boundary: Polygon, points: Array) -> tuple[float, float, float]:
    """Return the maximum distance of the area inside a boundary from the nearest of `points`, shape (n, 2) [m], and the
    position (x, y) with this distance [m]."""
    from scipy.spatial import KDTree

    x, y, inside = _nodes(boundary)
    rows, columns = np.nonzero(inside)
    places = np.vstack([np.column_stack([x[columns], y[rows]]), shapely.get_coordinates(boundary)])
    away = KDTree(points).query(places)[0]
    k = int(np.argmax(away))
    return float(away[k]), *places[k].tolist()


def _nodes(boundary: Polygon) -> tuple[Array, Array, Array]:
    """Return the coordinates of the columns and rows of a grid [m], and whether its nodes are inside the boundary."""
    west, south, east, north = boundary.bounds
    step = max(STEP_M, max(east - west, north - south) / MOST_STEPS)
    x, y = (low + step * np.arange(ceil((high - low) / step) + 1) for low, high in ((west, east), (south, north)))
    shapely.prepare(boundary)
    return x, y, shapely.intersects_xy(boundary, *np.meshgrid(x, y))


def slope_numbers(relief: Relief) -> dict[str, Any]:
    """Return the mean and the maximum slope [deg], the directions in which the ground falls, counter-clockwise from
    east [deg], and the range of the heights [m]. The mean direction is None if the field has no common direction."""
    slopes = np.hypot(relief.east, relief.north)
    mean, east, north = (float(np.nanmean(values)) for values in (slopes, relief.east, relief.north))
    row, column = np.unravel_index(int(np.nanargmax(slopes)), slopes.shape)
    common = hypot(east, north) > COMMON * mean
    return {
        "mean_deg": degrees(np.arctan(mean)),
        "falls_to_deg": degrees(atan2(-north, -east)) if common else None,
        "max_deg": degrees(np.arctan(slopes[row, column])),
        "max_falls_to_deg": degrees(atan2(-relief.north[row, column], -relief.east[row, column])),
        "max_x_m": float(relief.x[column]),
        "max_y_m": float(relief.y[row]),
        "lowest_m": float(np.nanmin(relief.heights)),
        "highest_m": float(np.nanmax(relief.heights)),
        "notes": list(relief.notes),
    }


def slope_text(numbers: dict[str, Any]) -> str:
    """Return a sentence about the slope of a field, for numbers of `slope_numbers`."""
    if numbers["max_deg"] < LEVEL_DEG:
        return "level ground"
    mean, common = f"mean slope {numbers['mean_deg']:.1f} deg", numbers["falls_to_deg"]
    falls = "" if common is None else f", falling to the {_compass_point(common)}"
    place = f"({numbers['max_x_m']:.0f}, {numbers['max_y_m']:.0f}) m"
    steepest = f"{numbers['max_deg']:.1f} deg to the {_compass_point(numbers['max_falls_to_deg'])} at {place}"
    rise = numbers["highest_m"] - numbers["lowest_m"]
    return f"{mean}{falls}; maximum {steepest}; height difference {rise:.1f} m"


def _compass_point(angle: float) -> str:
    """Return the compass point next to an angle counter-clockwise from east [deg]."""
    return POINTS[round(angle / 45) % 8]
