"""Figure-eight of the paper: two straights that cross at the origin, joined by two tangent arcs.

With straights of length 2 h and arcs of radius r, the straights are inclined at +-phi to the east axis with tan(phi) =
r / h. Each arc turns through 2 pi - 2 atan(h / r). The long axis points east. A lap starts at the crossing, in the
middle of the first straight, with a heading to the north-east. It follows the eastern arc to the right and the western
arc to the left. The first lap starts at full speed after a run-in on the first straight. The reference continues after
the last lap.

The curvature has steps where straights and arcs meet, as in the paper. With transition = "clothoid", clothoids are
inserted; the straights keep their length and the arcs their radius. Measured along a straight from the crossing, the
centre of the next arc is then m ahead and n to the side (h and r without clothoids). The centre lies on the east axis,
so that tan(phi) = n / m. The clothoids and the arc together turn through pi + 2 phi.

The paper shows its figure-eight without dimensions; it specifies two laps, and about 120 s for the first lap.
"""

from functools import lru_cache
from math import atan, atan2, ceil, isinf, pi, sqrt
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from agrobot_mj.core.kernels import shared, stage
from agrobot_mj.core.samples import write_reference
from agrobot_mj.core.signals import Matrix, Reference, Vector
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.paths.arc import RAMP_S, Place, Pose, Ramp, advance, progress, reference_along, turns
from agrobot_mj.paths.base import ReferencePath
from agrobot_mj.paths.track import Piece
from agrobot_mj.paths.transition import Transitions, bend


class _Piece(NamedTuple):
    """Segment of a lap: a straight, an arc or a clothoid."""

    start: float  # Arc length at the start of the segment [m], from the start of the lap
    x: float  # East coordinate of the start of the segment [m]
    y: float  # North coordinate of the start of the segment [m]
    yaw: float  # Heading at the start of the segment [rad]
    curvature: float  # Curvature at the start of the segment [1/m]
    sharpness: float  # Change of curvature per metre [1/m2]


@lru_cache(maxsize=16)
def _pieces(radius: float, straight: float, sharpness: float) -> tuple[tuple[_Piece, ...], float]:
    """Return the segments of one lap in reverse order (last segment first), and the length of the lap [m]."""
    half, crossing = straight / 2, atan(radius / (straight / 2))
    right, left = [Piece(arc := radius * (2 * pi - 2 * atan(half / radius)), -1 / radius)], [Piece(arc, 1 / radius)]
    if not isinf(sharpness):
        ahead, aside = bend(pi, radius, sharpness).centre
        crossing = atan2(aside, half + ahead)
        curve = bend(pi + 2 * crossing, radius, sharpness)
        right, left = curve.pieces(-1.0), curve.pieces(1.0)
    pieces, start, pose = [], 0.0, Pose(0.0, 0.0, crossing)
    for piece in (Piece(half), *right, Piece(straight), *left, Piece(half)):
        pieces.append(_Piece(start, *pose, piece.curvature, piece.sharpness))
        pose = advance(pose, piece.curvature, piece.length, piece.sharpness)
        start += piece.length
    return tuple(reversed(pieces)), start


@shared
def _lap_position(t: float, ramp: float, speed: float, run_in: float, length: float) -> tuple[float, float]:
    """Return the distance from the start of the current lap [m] and the reference speed [m/s] at time `t` [s]."""
    moved, fraction = progress(t, ramp)
    return (speed * moved - run_in) % length, fraction * speed


@shared
def _on_piece(piece: _Piece, distance: float, speed: float) -> Reference:
    """Return the reference state on a segment of the lap, at the `distance` [m] from the start of the lap."""
    start, sharpness = Pose(piece.x, piece.y, piece.yaw), piece.sharpness
    return reference_along(start, piece.curvature, sharpness, distance - piece.start, speed, sharpness)


@stage
def _references(pieces: Matrix, ramp: float, speed: float, run_in: float, length: float, times: Vector) -> Matrix:
    references = np.empty((times.size, 7))
    for n, t in enumerate(times):
        distance, now = _lap_position(t, ramp, speed, run_in, length)
        k = 0
        while pieces[k, 0] > distance:
            k += 1
        p = pieces[k]
        write_reference(references, n, _on_piece(_Piece(p[0], p[1], p[2], p[3], p[4], p[5]), distance, now))
    return references


class FigureEight(Transitions, ReferencePath):
    """Path of complete laps of a figure-eight. With the default values, one lap takes 119.7 s."""

    radius_key: ClassVar = "radius_m"

    kind: Literal["figure_eight"] = "figure_eight"
    radius_m: Positive = 10.0
    """Radius of the arcs [m]. Assumed value (range 8-10), which fits the paper's 120 s per lap."""
    straight_m: Positive = 28.0
    """Length of each straight, excluding clothoids [m]. Assumed value, for which the default lap takes 119.7 s."""
    ramp_s: Ramp = RAMP_S
    """Duration of the acceleration from rest [s], or 0 for no ramp. Assumed value (range 2-6) for typical drivers."""
    run_in_m: NonNegative = 14.0
    """Distance travelled before the first lap [m], at most half a straight. Assumed value, which is sufficient to reach
    full speed."""
    turns: Annotated[int, Field(ge=1, le=1000)] = 2
    """Number of laps [-]. Paper."""

    @model_validator(mode="after")
    def _check_lengths(self) -> Self:
        self.check()
        return self

    def check(self) -> None:
        """Raise ValueError if the run-in exceeds half a straight, or if the radius is too small for the clothoids."""
        if self.run_in_m > self.straight_m / 2:
            raise ValueError(f"run_in_m: must be at most half of straight_m, {self.straight_m / 2:g}")
        if (least := 1 / sqrt(pi * self.sharpness(self.speed_m_s))) > self.radius_m:
            raise ValueError(
                f"radius_m: must be at least {ceil(100 * least) / 100:g} for clothoids at {self.speed_m_s:g} m/s"
            )

    @property
    def turn_s(self) -> float:
        """Duration of one lap at full speed [s]."""
        return _lap(self)[1] / self.speed_m_s

    @property
    def duration_s(self) -> float:
        """Time from the start to the end of the last lap, including the run-in [s]."""
        return self.turns_s[-1][1]

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """Start and end times of each lap [s]; the first lap starts after the run-in."""
        return turns(self.turn_s, self.turns, self.ramp_s, self.run_in_m / self.speed_m_s)

    @property
    def max_curvature(self) -> float:
        """Absolute curvature of the arcs [1/m], which is the maximum of the path."""
        return 1 / self.radius_m

    @property
    def sharpest(self) -> Place:
        """First point of maximum curvature: the start of the first arc."""
        arc = next(p for p in reversed(_lap(self)[0]) if abs(p.curvature) > 0.999999 * self.max_curvature)
        return Place(arc.x, arc.y, self.run_in_m + arc.start)

    def at(self, t: float) -> Reference:
        """Return the reference state at time `t` [s]; the figure-eight continues after the last lap."""
        pieces, length = _lap(self)
        distance, speed = _lap_position(t, self.ramp_s, self.speed_m_s, self.run_in_m, length)
        return _on_piece(next(piece for piece in pieces if piece.start <= distance), distance, speed)

    def _references_at(self, times: Vector) -> Matrix:
        pieces, length = _lap(self)
        return _references(np.array(pieces), self.ramp_s, self.speed_m_s, self.run_in_m, length, times)


def _lap(path: FigureEight) -> tuple[tuple[_Piece, ...], float]:
    return _pieces(path.radius_m, path.straight_m, path.sharpness(path.speed_m_s))
