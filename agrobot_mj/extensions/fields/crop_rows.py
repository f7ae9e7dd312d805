"""Crop rows that the tractor wheels run over outside the tramlines.

Rows are parallel lines on the body of the field, in the direction of the swaths or in a given direction. Both edges of
the first swath are midway between two rows if the working width is a multiple of the row spacing. Tramlines are the
ground under the wheels on exactly followed passes. The track of a wheel has the width of its tyre. Each part of a row
counts once, and only if it is outside the tramlines. Wheels of the implement are not counted.
"""

from math import ceil, floor, radians
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.boom import ImplementMotion, swept_area
from agrobot_mj.extensions.fields.plan import Plan
from agrobot_mj.extensions.fields.planner.rig import FieldMachine
from agrobot_mj.extensions.fields.planner.swaths import SwathFrame
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.simulation.log import Log

PART_S = 30.0  # Duration of the sections into which the track of a wheel is divided [s]


class CropRows(NamedTuple):
    """Spacing and direction of parallel crop rows."""

    spacing: float  # Distance between rows [m]
    angle_deg: float  # Direction of the rows, counter-clockwise from east [deg]


def crop_rows(plan: Plan, spacing: float | None, angle_deg: float | None) -> CropRows | None:
    """Return the spacing and direction of crop rows, or None if `spacing` is None. Default direction: along the swaths.

    Raise `ScenarioError` if only a direction is given, or only a spacing for a plan without a swath direction.
    """
    angle = plan.angle_deg if angle_deg is None else angle_deg
    if spacing is None and angle_deg is not None:
        raise ScenarioError(f"--row-angle {angle_deg:g}: the row spacing is missing; set --row-spacing")
    if spacing is not None and angle is None:
        raise ScenarioError(f"--row-spacing {spacing:g}: the plan has no swath direction; set --row-angle")
    return None if spacing is None or angle is None else CropRows(spacing, angle)


def lines_of(rows: CropRows, plan: Plan, body: BaseGeometry) -> Array:
    """Return the crop rows on the field body `body` as lines, shape (n,), clipped to the body."""
    frame, (x, y, _) = SwathFrame(radians(rows.angle_deg)), plan.course.joints()
    first = next((one for one in plan.passes if one.part == "body"), None)
    if first is None or body.is_empty:
        return np.empty(0, object)
    k = int(np.searchsorted(plan.course.distances(), first.start, "right")) - 1
    edge = frame.of(np.array([[x[k], y[k]]]))[0, 1] - plan.width / 2 + rows.spacing / 2
    along, across = frame.of(shapely.get_coordinates(body)).T
    numbers = range(ceil((across.min() - edge) / rows.spacing), floor((across.max() - edge) / rows.spacing) + 1)
    ends = [[frame.pose(a, edge + n * rows.spacing)[:2] for a in (along.min(), along.max())] for n in numbers]
    found: Array = shapely.intersection(shapely.linestrings(np.array(ends).reshape(-1, 2, 2)), body)
    return found


def run_over(rows: CropRows, plan: Plan, body: BaseGeometry, rig: FieldMachine, log: Log) -> dict[str, float]:
    """Return the total length of crop rows [m], and the length [m] and percentage run over outside the tramlines."""
    tractor, lines = log.scenario.tractor, lines_of(rows, plan, body)
    motion = np.column_stack([log.column(name) for name in ("t", "x", "y", "yaw", "steer")])
    driven = wheel_tracks(tractor, *motion[np.isfinite(motion).all(axis=1)].T)
    tramlines = _tramlines(plan, rig, tractor)
    trees = shapely.STRtree(driven), shapely.STRtree(tramlines)
    crossed = 0.0
    for line in lines:
        track, tram = (shapely.union_all(tree.geometries[tree.query(line, "intersects")]) for tree in trees)
        crossed += line.intersection(track).difference(tram).length
    whole = float(shapely.length(lines).sum())
    share = 100 * crossed / whole if whole else 0.0
    return {"spacing_m": rows.spacing, "rows_m": whole, "run_over_m": crossed, "run_over_percent": share}


def _tramlines(plan: Plan, rig: FieldMachine, tractor: TractorParameters) -> list[BaseGeometry]:
    """Return the ground areas that the wheels cover on the swaths inside the headland, if the tractor follows the plan
    exactly."""
    course = plan.course.divided()
    x, y, yaw = course.joints()
    s = course.distances()
    found = list[BaseGeometry]()
    for one in plan.passes:
        rows = (s >= one.start - rig.behind - rig.front) & (s <= one.end)
        if one.part == "body" and rows.sum() > 1:
            found += wheel_tracks(tractor, s[rows], x[rows], y[rows], yaw[rows], np.zeros(int(rows.sum())))
    return found


def wheel_tracks(
    tractor: TractorParameters, t: Array, x: Array, y: Array, yaw: Array, steer: Array
) -> list[BaseGeometry]:
    """Return the ground under each of the four wheels in each interval of `PART_S`. The inputs are n CG poses and wheel
    angles `steer` [rad] at increasing times `t` [s]."""
    found, c, s = list[BaseGeometry](), np.cos(yaw), np.sin(yaw)
    starts = np.arange(t[0], t[-1], PART_S)
    for ahead, width, angle in (
        (tractor.cg_to_front_axle, tractor.front_wheel_width_m, steer),
        (-tractor.cg_to_rear_axle, tractor.rear_wheel_width_m, 0.0 * steer),
    ):
        for left in (tractor.track_m / 2, -tractor.track_m / 2):
            at = x + ahead * c - left * s, y + ahead * s + left * c
            motion = ImplementMotion(t, *at, np.unwrap(yaw + angle), t)
            found += [
                swept_area(motion.between(start, min(start + PART_S, t[-1])), width / 2, -width / 2)
                for start in starts.tolist()
            ]
    return found
