"""Areas of a field for the planner (drivable area, and body inside the headland laps), and checks of courses."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.coverage import depths, sides_of
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.plan import Plan
from agrobot_mj.extensions.fields.planner.laps import Ring, offset, rings, smooth_ring
from agrobot_mj.extensions.fields.planner.rig import BAR_M, FieldMachine, implement_boxes, tractor_boxes, tractor_poses
from agrobot_mj.extensions.fields.repair import polygons_of
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.track import Piece, chain

TOLERANCE_M = 0.05  # Permitted distance of the machine beyond the boundary, for rounded corners and coordinates [m]
SWING_M = 0.3
"""Additional permitted distance of the implement ends beyond the boundary in bends [m]. Assumed value (range 0-0.5)."""
THIN, LEAST_PART = 0.3, 2.0
"""Half of the minimum width, divided by the working width, and minimum area, divided by the square of the working
width, of a part of the headland that gets swaths [-]. Assumed values."""
ENTERED_M = 0.2
"""Maximum reported distance by which a boundary between the corners of an outline is inside this outline [m]. Assumed
value: a higher limit would require wider margins, which leave more of the field without work."""
GRID_M = 1e-4  # Grid to which areas are rounded, because GEOS cannot intersect some areas exactly [m]
BLOCK = 4096  # Number of poses whose outlines are computed at a time, to limit memory usage


@dataclass(frozen=True)
class Area:
    """Drivable area, body and headland laps of a field for one machine."""

    whole: BaseGeometry  # Area of the field without obstacles, in which tractor and implement may move
    worked: BaseGeometry  # Area without the margin along the boundary
    body: BaseGeometry  # Body of the field: area inside the headland laps, which the swaths cover
    laps: tuple[Ring, ...]  # Headland laps in driving order
    rig: FieldMachine
    beyond: float = 0.0  # Permitted distance of the machine beyond the boundary [m]

    @cached_property
    def _allowed(self) -> BaseGeometry:
        allowed = self.whole.buffer(TOLERANCE_M)
        shapely.prepare(allowed)
        return allowed

    @cached_property
    def _sides(self) -> shapely.STRtree:
        return sides_of(self.whole)

    @cached_property
    def _inner_body(self) -> BaseGeometry:
        return offset(self.body, self.rig.width / 2)

    def extended(self, more: BaseGeometry) -> "Area":
        """Return the same areas with the body extended by `more`."""
        return replace(self, body=_polygonal(shapely.union(self.body, more, grid_size=GRID_M)))

    @property
    def omitted(self) -> BaseGeometry:
        """Parts of the headland that no lap works, because the laps have no space for a bend, and that are large enough
        for swaths."""
        laps = shapely.union_all([ring.line.buffer(self.rig.spacing / 2, join_style="mitre") for ring in self.laps])
        return self.large_parts(self.worked, laps, self.body)

    def large_parts(self, area: BaseGeometry, *others: BaseGeometry) -> BaseGeometry:
        """Return the parts of `area` outside `others` that are large enough for swaths."""
        for other in others:
            area = _polygonal(shapely.difference(area, other, grid_size=GRID_M))
        thin = THIN * self.rig.spacing
        wide = shapely.intersection(area.buffer(-thin).buffer(thin, join_style="mitre"), area, grid_size=GRID_M)
        least = LEAST_PART * self.rig.spacing**2
        return shapely.union_all([part for part in shapely.get_parts(wide) if part.area > least])

    def outside(self, x: Array, y: Array, yaw: Array) -> Array:
        """Return the distances of tractor, implement and middle of the implement beyond the boundary for n CG poses,
        shape (3, n) [m].

        Obstacles between the corners of their outlines count. The middle of the implement excludes the ends that may
        swing. Its distance is 0, or `ENTERED_M` if the boundary or an obstacle is inside its outline.
        """
        found = np.zeros((3, len(x)))
        for first in range(0, len(x), BLOCK):
            block = slice(first, first + BLOCK)
            found[:, block] = self._outside(x[block], y[block], yaw[block])
        return found

    def _outside(self, x: Array, y: Array, yaw: Array) -> Array:
        behind = self.rig.behind
        bar = x - behind * np.cos(yaw), y - behind * np.sin(yaw), yaw
        boxes = np.stack([tractor_boxes(self.rig, x, y, yaw), implement_boxes(self.rig, *bar)])
        out = ~shapely.covers(self._allowed, boxes)
        found = np.zeros((3, len(x)))
        outer = boxes[out]
        corners = shapely.get_coordinates(outer).reshape(-1, 5, 2)
        away = shapely.distance(shapely.points(corners), self.whole).max(axis=1)
        between = np.flatnonzero(away <= TOLERANCE_M)  # the boundary is between the corners
        away[between] = depths(outer[between], self.whole, self._sides, ENTERED_M)
        found[:2][out] = away
        swung = np.flatnonzero(out[1])
        middle = implement_boxes(self._without_ends, *(values[swung] for values in bar))
        found[2, swung[~shapely.covers(self._allowed, middle)]] = ENTERED_M
        return found

    @property
    def _without_ends(self) -> FieldMachine:
        """Machine whose implement lacks the ends that may swing beyond the boundary."""
        return replace(self.rig, width=max(self.rig.width - 2 * (SWING_M + TOLERANCE_M), 2 * BAR_M))

    def faults(self, start: Pose, pieces: tuple[Piece, ...]) -> tuple[float, float]:
        """Return two lengths for a connection along `pieces` [m]: maximum excess over the permitted distance beyond the
        boundary, and length inside the headland laps."""
        if not any(piece.length > 1e-9 for piece in pieces):
            return 0.0, 0.0
        x, y, yaw = tractor_poses(chain(start, pieces).divided(), self.rig.cg_to_rear_axle)
        across = shapely.LineString(np.column_stack([x, y])).intersection(self._inner_body).length
        return float(self.excess(self.outside(x, y, yaw)).max()), float(across)

    def excess(self, outside: Array) -> Array:
        """Return the excess of `outside` (3, n) over the permitted distance beyond the boundary, shape (n,) [m].

        The permitted distance of the implement is larger by SWING_M, because its ends swing out in bends.
        """
        found = (outside - self.beyond - np.array([[0.0], [SWING_M], [0.0]])).max(axis=0)
        return np.where(found > TOLERANCE_M, found, 0.0)


def _polygonal(shape: BaseGeometry) -> BaseGeometry:
    """Return the polygons of a shape, without lines and points of zero area."""
    return shapely.union_all(polygons_of(shape))


def whole_of(field: Field) -> BaseGeometry:
    """Return the area of a field without its obstacles."""
    return field.boundary.difference(shapely.union_all(list(field.obstacles)))


def body_of(field: Field, plan: Plan) -> BaseGeometry:
    """Return the body of a field, which is the area inside the headland laps of a plan."""
    return inside_laps(whole_of(field), plan)


def inside_laps(whole: BaseGeometry, plan: Plan) -> BaseGeometry:
    """Return the area inside the headland laps of a plan. `whole` is the area of the field without obstacles."""
    return offset(whole, plan.margin + plan.overlap / 2 + plan.headlands * (plan.width - plan.overlap))


def area_of(field: Field, headlands: int, rig: FieldMachine, beyond: float = 0.0, margin: float = 0.0) -> Area:
    """Return the areas and laps of a field for planning. A `margin` [m] along the boundary is not worked."""
    whole, first = whole_of(field), margin + rig.overlap / 2
    worked, body = offset(whole, first), offset(whole, first + headlands * rig.spacing)
    laps = tuple(smooth_ring(ring, rig) for ring in rings(worked, headlands, rig.spacing))
    return Area(whole, worked, body, laps, rig, beyond)
