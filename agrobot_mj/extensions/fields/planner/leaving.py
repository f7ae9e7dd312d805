"""Detection of points at which a plan leaves its field.

A wider margin corrects laps that leave the field; additional headland laps correct turns that leave the field.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.plan import PlannedPass
from agrobot_mj.extensions.fields.planner.area import Area
from agrobot_mj.extensions.fields.planner.rig import tractor_poses
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.track import Piece, chain

CUT_M = 0.5  # Distance by which discs extend into an area, in addition to the excess [m]
WARNED_M = 0.1  # Distance beyond the boundary above which a warning is given [m]
LEAVES = "the machine leaves the field", "the ends of the implement swing beyond the boundary"
"""First words of two warnings: for a machine outside the field, and for implement ends beyond the boundary."""
PLACES_TOLD = 5  # Maximum number of places listed in a warning


@dataclass(frozen=True)
class Leaving:
    """Distances of the machine beyond the boundary at n points of a course."""

    x: Array  # East coordinate of the CG [m]
    y: Array  # North coordinate of the CG [m]
    outside: Array  # Distances of tractor, implement and middle of the implement (see `Area.outside`), shape (3, n) [m]
    excess: Array  # Distance by which the permitted distance beyond the boundary is exceeded [m]
    in_lap: Array  # Whether each point is on a headland lap

    @property
    def laps(self) -> float:
        """Maximum excess over the permitted distance beyond the boundary on headland laps [m]."""
        return float(np.where(self.in_lap, self.excess, 0.0).max())

    @property
    def turns(self) -> float:
        """Maximum excess over the permitted distance beyond the boundary on swaths, turns and connections [m]."""
        return float(np.where(self.in_lap, 0.0, self.excess).max())

    @property
    def largest(self) -> str:
        """Text with the maximum distance beyond the boundary and its position. Headland laps count only if no other
        part of the course leaves the field."""
        values = np.where(self.in_lap, 0.0, self.excess) if self.turns else self.excess
        k = int(np.argmax(values))
        return f"{self.outside[:, k].max():.2f} m near ({self.x[k]:z.0f}, {self.y[k]:z.0f}) m"

    def surroundings(self, area: BaseGeometry) -> BaseGeometry:
        """Return discs around the points at which turns leave the field. A disc extends into `area` by the excess."""
        rows = np.flatnonzero(np.where(self.in_lap, 0.0, self.excess))
        points = shapely.points(self.x[rows], self.y[rows])
        return shapely.union_all(shapely.buffer(points, shapely.distance(points, area) + self.excess[rows] + CUT_M))

    def warnings(self) -> list[str]:
        """Return warnings with the positions at which the plan leaves the field. The list is empty for a plan inside
        the field."""
        swings = self.outside[1] * (self.excess <= 0.0) * (self.outside[0] <= WARNED_M)
        leaves = np.where(swings > 0.0, 0.0, self.outside.max(axis=0))
        said = zip(LEAVES, (leaves, swings), strict=True)
        return [f"{what} by {self._places(values)}" for what, values in said if values.max() > WARNED_M]

    def _places(self, outside: Array) -> str:
        """Return a text with the maximum distance beyond the boundary, and the positions of local maxima, rounded to 1
        m."""
        places = sorted(_peaks(outside, WARNED_M), key=lambda k: -outside[k])
        told = list(dict.fromkeys(f"({self.x[k]:z.0f}, {self.y[k]:z.0f})" for k in places))
        more = f" and {len(told) - PLACES_TOLD} more" if len(told) > PLACES_TOLD else ""
        return f"up to {outside[places[0]]:.2f} m at {', '.join(told[:PLACES_TOLD])} m{more}"


def leaving(area: Area, start: Pose, pieces: Sequence[Piece], passes: Sequence[PlannedPass] = ()) -> Leaving:
    """Return the distances of the machine beyond the boundary along a course.

    The passes `passes` determine which points belong to headland laps.
    """
    course = chain(start, pieces).divided()
    x, y, yaw = tractor_poses(course, area.rig.cg_to_rear_axle)
    outside, s = area.outside(x, y, yaw), course.distances()
    in_lap = np.zeros(len(x), dtype=bool)
    for one in passes:
        if one.part == "headland":
            in_lap |= (s >= one.start - area.rig.behind) & (s <= one.end)
    return Leaving(x, y, outside, area.excess(outside), in_lap)


def _peaks(values: Array, limit: float) -> list[int]:
    above = np.concatenate(([False], values > limit, [False]))
    starts, ends = np.flatnonzero(~above[:-1] & above[1:]), np.flatnonzero(above[:-1] & ~above[1:])
    return [int(a + np.argmax(values[a:b])) for a, b in zip(starts, ends, strict=True)]
