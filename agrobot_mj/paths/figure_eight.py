"""The 8 of the paper: two straights that cross at the origin, joined by two arcs tangent to them.

With straights of length 2 h and arcs of radius r, the straights lie at +-phi to the east axis with
tan(phi) = r / h, and each arc turns through 2 pi - 2 atan(h / r). The 8 lies along east. A turn begins at the
crossing, the middle of the first straight, heads to the north-east, and takes the eastern arc to the right
and the western one to the left. A run-in on the first straight comes before the first turn, so that the tractor is
up to speed when it begins. The reference goes on round beyond the last turn.

The curvature steps where straights and arcs meet, as in the paper. With transition = "clothoid" a clothoid lies between
them: the straights keep their length and the arcs their radius. Seen along a straight from the crossing, the centre of
the next arc then lies m ahead and n aside (h and r without clothoids), and since it lies on the east axis,
tan(phi) = n / m; clothoids and arc together turn through pi + 2 phi.

The paper shows its 8 but gives no dimensions; it gives two turns and that the first takes about 120 s.
"""

from functools import lru_cache
from math import atan, atan2, ceil, isinf, pi, sqrt
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from agrobot_mj.core.signals import Reference
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.paths.arc import RAMP_S, Place, Pose, Ramp, advance, progress, reference, turns
from agrobot_mj.paths.base import ReferencePath
from agrobot_mj.paths.track import Piece
from agrobot_mj.paths.transition import Transitions, bend


class _Piece(NamedTuple):
    """A straight, an arc or a clothoid of a turn."""

    start: float
    """Where it begins, from the beginning of the turn [m]."""
    pose: Pose
    curvature: float
    """Curvature there [1/m]."""
    sharpness: float
    """Change of curvature per metre [1/m2]."""


@lru_cache(maxsize=16)
def _pieces(radius: float, straight: float, sharpness: float) -> tuple[tuple[_Piece, ...], float]:
    """The pieces of one turn, last one first, and the length of the turn [m]."""
    half, crossing = straight / 2, atan(radius / (straight / 2))
    right, left = [Piece(arc := radius * (2 * pi - 2 * atan(half / radius)), -1 / radius)], [Piece(arc, 1 / radius)]
    if not isinf(sharpness):
        ahead, aside = bend(pi, radius, sharpness).centre
        crossing = atan2(aside, half + ahead)
        curve = bend(pi + 2 * crossing, radius, sharpness)
        right, left = curve.pieces(-1.0), curve.pieces(1.0)
    pieces, start, pose = [], 0.0, Pose(0.0, 0.0, crossing)
    for piece in (Piece(half), *right, Piece(straight), *left, Piece(half)):
        pieces.append(_Piece(start, pose, piece.curvature, piece.sharpness))
        pose = advance(pose, piece.curvature, piece.length, piece.sharpness)
        start += piece.length
    return tuple(reversed(pieces)), start


class FigureEight(Transitions, ReferencePath):
    """Whole turns of an 8; the defaults take 119.7 s a turn."""

    radius_key: ClassVar = "radius_m"

    kind: Literal["figure_eight"] = "figure_eight"
    radius_m: Positive = 10.0
    """Radius of the arcs [m]; assumed value: 8-10 m fits the paper's 120 s a turn."""
    straight_m: Positive = 28.0
    """Length of each straight, without its clothoids [m]; assumed value: 119.7 s a turn with the other defaults."""
    ramp_s: Ramp = RAMP_S
    """Time over which the speed rises from rest; 0: at once [s]. Assumed value (2-6): what a driver takes."""
    run_in_m: NonNegative = 14.0
    """Way to the crossing before the first turn begins, at most half a straight [m]. Assumed value: up to speed."""
    turns: Annotated[int, Field(ge=1, le=1000)] = 2
    """How often to go round [-]. Paper."""

    @model_validator(mode="after")
    def _checked(self) -> Self:
        self.check()
        return self

    def check(self) -> None:
        """Raises ValueError for a run-in, or for clothoids, that do not fit; the clothoids depend on the wheelbase."""
        if self.run_in_m > self.straight_m / 2:
            raise ValueError(f"run_in_m: must be at most half of straight_m ({self.straight_m / 2:g})")
        if (least := 1 / sqrt(pi * self.sharpness(self.speed_m_s))) > self.radius_m:
            raise ValueError(f"radius_m: clothoids at {self.speed_m_s:g} m/s need at least {ceil(100 * least) / 100:g}")

    @property
    def turn_s(self) -> float:
        """Time of one turn at full speed [s]."""
        return _lap(self)[1] / self.speed_m_s

    @property
    def duration_s(self) -> float:
        """Time of the run-in and all turns [s]."""
        return self.turns_s[-1][1]

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """(start, end) of each turn [s]."""
        return turns(self.turn_s, self.turns, self.ramp_s, self.run_in_m / self.speed_m_s)

    @property
    def max_curvature(self) -> float:
        """Largest absolute curvature [1/m]."""
        return 1 / self.radius_m

    @property
    def sharpest(self) -> Place:
        """First place of the largest curvature: the beginning of the first arc."""
        arc = next(p for p in reversed(_lap(self)[0]) if abs(p.curvature) > 0.999999 * self.max_curvature)
        return Place(arc.pose.x, arc.pose.y, self.run_in_m + arc.start)

    def at(self, t: float) -> Reference:
        """The reference at time `t` [s] since the start; any `t`, the 8 goes on."""
        pieces, length = _lap(self)
        moved, share = progress(t, self.ramp_s)
        distance = (self.speed_m_s * moved - self.run_in_m) % length
        start, pose, curvature, sharpness = next(piece for piece in pieces if piece.start <= distance)
        pose = advance(pose, curvature, distance - start, sharpness)
        if sharpness:
            curvature += sharpness * (distance - start)
        return reference(pose, curvature, share * self.speed_m_s, sharpness)


def _lap(path: FigureEight) -> tuple[tuple[_Piece, ...], float]:
    """The pieces of one turn, last one first, and the length of the turn [m]."""
    return _pieces(path.radius_m, path.straight_m, path.sharpness(path.speed_m_s))
