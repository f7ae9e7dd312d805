"""Manoeuvre: a sequence of straights, arcs and clothoids, travelled forward or in reverse.

Each segment (`[[path.piece]]`) starts at the end of the previous segment with the same heading. With `reverse = true`
the tractor stops, waits for `cusp_pause_s`, and travels along the segment in reverse. `side` is the direction in which
the wheels are turned: in reverse on an arc to the left, the heading rotates to the right. The curvature may have steps
between segments; a clothoid from 0 to the curvature of an arc avoids a step.

In the default manoeuvre the tractor passes a row and reverses into it.
"""

from math import radians
from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.spec import NonNegative, Positive, Spec
from agrobot_mj.paths.arc import Pose, Speed
from agrobot_mj.paths.parallel import Coordinate
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.track import Course, Piece, chain

Curvature = Annotated[float, Field(ge=-10, le=10)]


class CoursePiece(Spec):
    """Base class of the segments of a manoeuvre; subclasses define `shape`."""

    kind: str
    reverse: bool = False
    """Whether the tractor travels along the segment in reverse."""
    speed_m_s: Speed | None = None
    """Maximum speed on the segment [m/s]. Default: the speed of the path."""

    def shape(self) -> tuple[float, float, float]:
        """Return length [m], initial curvature [1/m] and change of curvature per metre [1/m2] of the segment."""
        raise NotImplementedError

    def piece(self, speed: float) -> Piece:
        """Return the course segment. `speed` [m/s] is the maximum speed if the segment has no key `speed_m_s`."""
        length, curvature, sharpness = self.shape()
        allowed = speed if self.speed_m_s is None else self.speed_m_s
        return Piece(length, curvature, allowed, sharpness, -1.0 if self.reverse else 1.0)


class StraightPiece(CoursePiece):
    """Straight segment of a manoeuvre."""

    kind: Literal["straight"] = "straight"
    length_m: Positive
    """Length of the straight [m]."""

    def shape(self) -> tuple[float, float, float]:
        """Return the length of the straight [m], zero curvature and zero change of curvature."""
        return self.length_m, 0.0, 0.0


class ArcPiece(CoursePiece):
    """Segment of a manoeuvre that is a circular arc."""

    kind: Literal["arc"] = "arc"
    radius_m: Positive
    """Radius of the arc [m]."""
    angle_deg: Annotated[float, Field(gt=0, le=3600)]
    """Change of heading along the arc [deg]."""
    side: Literal["left", "right"] = "left"
    """Direction in which the wheels are turned, which is the side of the arc's centre."""

    def shape(self) -> tuple[float, float, float]:
        """Return the length [m] and the curvature [1/m] of the arc, and zero change of curvature."""
        curvature = (1.0 if self.side == "left" else -1.0) / self.radius_m
        return self.radius_m * radians(self.angle_deg), curvature, 0.0


class ClothoidPiece(CoursePiece):
    """Segment of a manoeuvre whose curvature changes linearly with the distance."""

    kind: Literal["clothoid"] = "clothoid"
    length_m: Positive
    """Length of the clothoid [m]."""
    from_per_m: Curvature = 0.0
    """Curvature at the start of the clothoid [1/m], positive to the left."""
    to_per_m: Curvature
    """Curvature at the end of the clothoid [1/m], positive to the left."""

    def shape(self) -> tuple[float, float, float]:
        """Return length [m], initial curvature [1/m] and change of curvature per metre [1/m2] of the clothoid."""
        return self.length_m, self.from_per_m, (self.to_per_m - self.from_per_m) / self.length_m


ManoeuvrePiece = Annotated[StraightPiece | ArcPiece | ClothoidPiece, Field(discriminator="kind")]

INTO_A_ROW = (
    StraightPiece(length_m=14.0),
    *(ClothoidPiece(length_m=1.5708, to_per_m=0.25), ArcPiece(radius_m=4.0, angle_deg=67.5)),
    ClothoidPiece(length_m=1.5708, from_per_m=0.25, to_per_m=0.0),
    StraightPiece(length_m=2.0),
    StraightPiece(length_m=22.0, reverse=True),
)
"""Segments of the default manoeuvre: forward in a left bend, then straight in reverse into a row."""


class Manoeuvre(Timed):
    """Path made of a sequence of segments."""

    kind: Literal["manoeuvre"] = "manoeuvre"
    speed_m_s: Speed = 0.8
    """Maximum speed of the reference [m/s]. Assumed value (range 0.3-1) for typical drivers in narrow spaces."""
    piece: Annotated[tuple[ManoeuvrePiece, ...], Field(min_length=1, max_length=1000)] = INTO_A_ROW
    """Segments in the order of travel, each given by a `[[path.piece]]` table."""
    cusp_pause_s: NonNegative = 2.0
    """Duration of the standstill at each cusp [s]. Assumed value (range 1-4) for changing gear and turning the
    wheels."""
    heading_deg: float = 0.0
    """Initial heading [deg], counter-clockwise from east."""
    start_x_m: Coordinate = 0.0
    """East coordinate of the start [m]."""
    start_y_m: Coordinate = 0.0
    """North coordinate of the start [m]."""

    def course(self) -> Course:
        """Return the geometry of the path through all segments."""
        start = Pose(self.start_x_m, self.start_y_m, radians(self.heading_deg))
        return chain(start, (piece.piece(self.speed_m_s) for piece in self.piece), self.cusp_pause_s)
