"""Headland laps: closed courses along the boundary and around obstacles, with corners that the machine can follow."""

from math import inf
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LinearRing, Polygon
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.planner.merging import MITRE, merge_corners
from agrobot_mj.extensions.fields.planner.rig import FieldMachine
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.fillet import Rounding, round_corners
from agrobot_mj.paths.track import Course, Piece

SIMPLE_M = 0.05  # Tolerance of the simplification of rings [m]
CORNER_M = 0.1  # Maximum distance of a rounded corner from the original corner, for a small change of direction [m]
DEVIATION = 0.1  # Maximum deviation of a rounded run of sides from the lap, divided by the working width [-]
SMOOTHER = (0.0, 1.0, 1.5, 2.5)
"""Smoothing radii of the line of a headland lap, divided by the turn radius [-]. The radii are tried in this order
until the machine can follow the line."""


class Ring(NamedTuple):
    """Headland lap as a closed polyline."""

    points: Array  # Corners in the order of driving [m], shape (n, 2). The first corner is not repeated.
    number: int  # Index of the lap, counted from 0 for the lap nearest to the boundary or obstacle
    hole: int = -1  # Index of the obstacle that the lap surrounds, or -1 for a lap along the boundary
    cuts: Array | None = None  # Distances added to the tolerance of each corner, shape (n,) [m]

    @property
    def reversed(self) -> "Ring":
        """Same lap in the opposite direction."""
        return self._replace(points=self.points[::-1], cuts=None if self.cuts is None else self.cuts[::-1])

    @property
    def line(self) -> LinearRing:
        """Headland lap as a shapely LinearRing."""
        return LinearRing(self.points)


def offset(area: BaseGeometry, inwards: float) -> BaseGeometry:
    """Return an area without the strip of width `inwards` [m] along its boundary."""
    return area.buffer(-inwards, join_style="mitre", mitre_limit=MITRE)


def rings(area: BaseGeometry, count: int, width: float) -> list[Ring]:
    """Return `count` laps: along the boundary from the outermost lap inwards, then around each obstacle outwards."""
    holes = [Polygon(hole) for part in shapely.get_parts(area) for hole in part.interiors]
    found = []
    for number in range(count):
        for part in shapely.get_parts(offset(area, (number + 0.5) * width)):
            if part.is_empty or part.geom_type != "Polygon":
                continue
            found.append(Ring(_corners(part.exterior, True), number))
            for inner in part.interiors:
                around = Polygon(inner)
                inside = next((k for k, hole in enumerate(holes) if around.contains(hole.representative_point())), -1)
                found.append(Ring(_corners(inner, False), number, inside))
    return sorted(found, key=lambda ring: (ring.hole, ring.number))


def _corners(ring: LinearRing, left: bool) -> Array:
    """Return the corners of a headland lap, counter-clockwise if `left`, otherwise clockwise. The longest side is
    first."""
    simple = LinearRing(ring).simplify(SIMPLE_M)
    points = np.array(simple.coords)[:-1, :2]
    if LinearRing(points).is_ccw != left:
        points = points[::-1]
    longest = int(np.argmax(np.hypot(*(np.roll(points, -1, axis=0) - points).T)))
    return np.roll(points, -longest, axis=0)


def from_point(ring: Ring, distance: float) -> tuple[Array, Array]:
    """Return the closed polyline of a headland lap, shape (n, 2) [m], starting at `distance` [m], and its cuts,
    shape (n,) [m]."""
    cuts = np.zeros(len(ring.points)) if ring.cuts is None else ring.cuts
    rows = np.column_stack([ring.points, cuts])
    closed = np.vstack([rows, rows[:1]])
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(closed[:, :2], axis=0).T))))
    distance %= along[-1]
    start = np.array([*(np.interp(distance, along, closed[:, k]) for k in range(2)), 0.0])
    after = along[:-1] > distance + 1e-3
    before = along[:-1] < distance - 1e-3
    found = np.vstack([start, rows[after], rows[before], start])
    return found[:, :2], found[:, 2]


def rounding(rig: FieldMachine) -> Rounding:
    """Return the parameters for rounding polyline corners within the turn limits of a machine."""
    path = rig.path
    return Rounding(path.turn_radius_m, CORNER_M, path.speed_m_s, path.lateral_acceleration_m_s2, path, shared=True)


def lap(ring: Ring, rig: FieldMachine) -> Course | None:
    """Return the geometry of a lap from the first corner, or None if the machine cannot follow the lap."""
    cuts = None if ring.cuts is None else np.append(ring.cuts, ring.cuts[0])
    return drivable(np.vstack([ring.points, ring.points[:1]]), True, rig, cuts)


def drivable(points: Array, closed: bool, rig: FieldMachine, cuts: Array | None = None) -> Course | None:
    """Return the geometry of a path along a polyline with rounded corners, or None if the machine cannot follow it.

    The machine cannot follow a reversal of the line or a bend below its turn radius.
    """
    try:
        course = round_corners(points, closed, rounding(rig), cuts)
    except ValueError:
        return None
    return course if course.peaks.max() <= rig.max_curvature else None


def start_at(course: Course, distance: float) -> Course:
    """Return the closed course from another start: the arc length `distance` [m] on a straight segment, or otherwise
    the nearest joint of two bends or middle of a straight segment."""
    ends = course.distances()
    straight = (course.curvatures == 0) & (course.sharpnesses == 0)
    k = int(np.clip(np.searchsorted(ends, distance, "right") - 1, 0, len(straight) - 1))
    if not straight[k]:
        starts = ends[:-1] + np.where(straight, course.lengths / 2, 0.0)
        away = np.abs(starts - distance)
        k = int(np.argmin(np.where(course.curvatures == 0, np.minimum(away, ends[-1] - away), inf)))
        distance = float(starts[k])
    x, y, yaw = (values[k] for values in course.joints())
    gone = distance - float(ends[k])
    start = Pose(float(x + gone * np.cos(yaw)), float(y + gone * np.sin(yaw)), float(yaw))
    order = (np.arange(len(straight) + 1) + k) % len(straight)
    lengths = course.lengths[order]
    lengths[0] -= gone
    lengths[-1] = gone
    others = (values[order] for values in course[2:])
    return Course(start, lengths, *others)


def smooth_ring(ring: Ring, rig: FieldMachine) -> Ring:
    """Return the headland lap with the smallest smoothing radius of `SMOOTHER` that the machine can follow. If there is
    none, return the original lap."""
    for factor in SMOOTHER:
        radius, found = factor * rig.path.turn_radius_m, ring
        if factor:
            area = Polygon(ring.points).buffer(-radius).buffer(2 * radius).buffer(-radius)
            if area.geom_type != "Polygon" or area.is_empty:
                continue
            found = ring._replace(points=_corners(area.simplify(CORNER_M).exterior, LinearRing(ring.points).is_ccw))
        points, cuts = merge_corners(found.points, rounding(rig), rig.width / 2, DEVIATION * rig.width)
        found = found._replace(points=points, cuts=cuts)
        if lap(found, rig) is not None:
            return found
    return ring


def pieces_of(course: Course) -> tuple[Piece, ...]:
    """Return the path segments of a course."""
    columns = (course.lengths, course.curvatures, course.speeds, course.sharpnesses, course.directions, course.pauses)
    return tuple(Piece(*row) for row in np.column_stack(columns).tolist())
