"""Headland laps: closed courses along the boundary and around obstacles, with corners that the machine can follow."""

from typing import NamedTuple

import numpy as np
import shapely
from shapely import LinearRing, Polygon
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.planner.rig import FieldMachine
from agrobot_mj.paths.fillet import Rounding, rounded
from agrobot_mj.paths.track import Course, Piece

MITRE = 5.0  # Maximum length of a mitred corner divided by the offset of the boundary [-]
SIMPLE_M = 0.05  # Tolerance of the simplification of rings [m]
CORNER_M = 0.1  # Maximum distance of a rounded corner from the original corner, for a small change of direction [m]
SMOOTHER = (0.0, 1.0, 1.5, 2.5)
"""Smoothing radii of the line of a headland lap, divided by the turn radius [-]. The radii are tried in this order
until the machine can follow the line."""


class Ring(NamedTuple):
    """Headland lap as a closed polyline."""

    points: Array  # Corners in the order of driving [m], shape (n, 2). The first corner is not repeated.
    number: int  # Index of the lap, counted from 0 for the lap nearest to the boundary or obstacle
    hole: int = -1  # Index of the obstacle that the lap surrounds, or -1 for a lap along the boundary

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


def from_point(ring: Ring, distance: float) -> Array:
    """Return the closed polyline of a headland lap, shape (n, 2) [m], starting at the arc length `distance` [m]."""
    closed = np.vstack([ring.points, ring.points[:1]])
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))))
    distance %= along[-1]
    start = np.array([np.interp(distance, along, closed[:, k]) for k in range(2)])
    after = along[:-1] > distance + 1e-3
    before = along[:-1] < distance - 1e-3
    return np.vstack([start, ring.points[after], ring.points[before], start])


def rounding(rig: FieldMachine) -> Rounding:
    """Return the parameters for rounding polyline corners within the turn limits of a machine."""
    path = rig.path
    return Rounding(path.turn_radius_m, CORNER_M, path.speed_m_s, path.lateral_acceleration_m_s2, path)


def lap(ring: Ring, distance: float, rig: FieldMachine) -> Course | None:
    """Return the geometry of a headland lap that starts at the arc length `distance` [m], or None if the machine cannot
    follow the lap."""
    return drivable(from_point(ring, distance), True, rig)


def drivable(points: Array, closed: bool, rig: FieldMachine) -> Course | None:
    """Return the geometry of a path along a polyline with rounded corners, or None if the machine cannot follow the
    polyline.

    The machine cannot follow a reversal of the line or a bend below its turn radius.
    """
    try:
        course = rounded(points, closed, rounding(rig))
    except ValueError:
        return None
    return course if course.peaks.max() <= rig.max_curvature else None


def smoothed(ring: Ring, rig: FieldMachine) -> Ring:
    """Return the headland lap with the smallest smoothing radius of `SMOOTHER` that the machine can follow. If there is
    none, return the original lap."""
    for factor in SMOOTHER:
        radius, found = factor * rig.path.turn_radius_m, ring
        if factor:
            area = Polygon(ring.points).buffer(-radius).buffer(2 * radius).buffer(-radius)
            if area.geom_type != "Polygon" or area.is_empty:
                continue
            found = ring._replace(points=_corners(area.simplify(CORNER_M).exterior, LinearRing(ring.points).is_ccw))
        if lap(found, 0.0, rig) is not None:
            return found
    return ring


def pieces_of(course: Course) -> tuple[Piece, ...]:
    """Return the path segments of a course."""
    columns = (course.lengths, course.curvatures, course.speeds, course.sharpnesses, course.directions, course.pauses)
    return tuple(Piece(*row) for row in np.column_stack(columns).tolist())
