"""A manoeuvre: straights, arcs and clothoids one after the other, forward or in reverse.

Each `[[path.piece]]` begins where the one before it ends, with its heading. `reverse = true` drives it backwards: the
tractor stops, stands for `cusp_pause_s`, and goes on in the other direction. `side` is where the wheels are turned, so
that reversing on an arc to the left turns the heading to the right. The curvature steps where the pieces let it; a
clothoid from 0 to the curvature of an arc avoids the step.

The default drives past a row and reverses into it.
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
    """What all pieces of a manoeuvre have; a kind gives its `shape`."""

    kind: str
    reverse: bool = False
    """Whether the piece is driven in reverse."""
    speed_m_s: Speed | None = None
    """Speed allowed on it; the path's own when left out [m/s]."""

    def shape(self) -> tuple[float, float, float]:
        """Length [m], curvature at its beginning [1/m] and change of curvature per metre driven [1/m2]."""
        raise NotImplementedError

    def piece(self, speed: float) -> Piece:
        """The piece of a course, where the path's speed is `speed` [m/s]."""
        length, curvature, sharpness = self.shape()
        allowed = speed if self.speed_m_s is None else self.speed_m_s
        return Piece(length, curvature, allowed, sharpness, -1.0 if self.reverse else 1.0)


class StraightPiece(CoursePiece):
    """Straight on."""

    kind: Literal["straight"] = "straight"
    length_m: Positive
    """Length [m]."""

    def shape(self) -> tuple[float, float, float]:
        """Length of the straight, without curvature."""
        return self.length_m, 0.0, 0.0


class ArcPiece(CoursePiece):
    """A part of a circle."""

    kind: Literal["arc"] = "arc"
    radius_m: Positive
    """Radius [m]."""
    angle_deg: Annotated[float, Field(gt=0, le=3600)]
    """Change of heading [deg]."""
    side: Literal["left", "right"] = "left"
    """Side to which the wheels are turned, on which the centre lies."""

    def shape(self) -> tuple[float, float, float]:
        """Length and curvature of the arc."""
        curvature = (1.0 if self.side == "left" else -1.0) / self.radius_m
        return self.radius_m * radians(self.angle_deg), curvature, 0.0


class ClothoidPiece(CoursePiece):
    """A curvature that changes linearly with the distance."""

    kind: Literal["clothoid"] = "clothoid"
    length_m: Positive
    """Length [m]."""
    from_per_m: Curvature = 0.0
    """Curvature at its beginning, left positive [1/m]."""
    to_per_m: Curvature
    """Curvature at its end, left positive [1/m]."""

    def shape(self) -> tuple[float, float, float]:
        """Length of the clothoid, its first curvature and the change per metre."""
        return self.length_m, self.from_per_m, (self.to_per_m - self.from_per_m) / self.length_m


ManoeuvrePiece = Annotated[StraightPiece | ArcPiece | ClothoidPiece, Field(discriminator="kind")]

INTO_A_ROW = (
    StraightPiece(length_m=14.0),
    *(ClothoidPiece(length_m=1.5708, to_per_m=0.25), ArcPiece(radius_m=4.0, angle_deg=67.5)),
    ClothoidPiece(length_m=1.5708, from_per_m=0.25, to_per_m=0.0),
    StraightPiece(length_m=2.0),
    StraightPiece(length_m=22.0, reverse=True),
)
"""Round a corner to the left, and straight back in reverse, past the corner, into the row on its other side."""


class Manoeuvre(Timed):
    """Pieces one after the other."""

    kind: Literal["manoeuvre"] = "manoeuvre"
    speed_m_s: Speed = 0.8
    """Largest speed of the reference [m/s]. Assumed value (0.3-1): what a driver takes in little room."""
    piece: Annotated[tuple[ManoeuvrePiece, ...], Field(min_length=1, max_length=1000)] = INTO_A_ROW
    """Pieces in the order in which they are driven, `[[path.piece]]`."""
    cusp_pause_s: NonNegative = 2.0
    """Standstill at each cusp [s]. Assumed value (1-4): to change gear and turn the wheels."""
    heading_deg: float = 0.0
    """Heading at the start, from east, counter-clockwise [deg]."""
    start_x_m: Coordinate = 0.0
    """Start, east [m]."""
    start_y_m: Coordinate = 0.0
    """Start, north [m]."""

    def course(self) -> Course:
        """All pieces."""
        start = Pose(self.start_x_m, self.start_y_m, radians(self.heading_deg))
        return chain(start, (piece.piece(self.speed_m_s) for piece in self.piece), self.cusp_pause_s)
