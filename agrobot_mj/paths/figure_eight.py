"""The 8 of the paper: two straights that cross at the origin, joined by two arcs tangent to them.

With straights of length 2 h and arcs of radius r, the straights lie at +-phi to the east axis with
tan(phi) = r / h, and each arc turns through 2 pi - 2 atan(h / r). The 8 lies along east. A turn begins at the
crossing, the middle of the first straight, heads to the north-east, and takes the eastern arc to the right
and the western one to the left. A run-in on the first straight comes before the first turn, so that the tractor is
up to speed when it begins. Curvature steps where straights and arcs meet. The reference goes on round beyond the last
turn.

The paper shows its 8 but gives no dimensions; it gives two turns and that the first takes about 120 s.
"""

from functools import lru_cache
from math import atan, pi
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from agrobot_mj.core.signals import Reference
from agrobot_mj.core.spec import NonNegative, Positive, Spec
from agrobot_mj.paths.arc import RAMP_S, Place, Pose, Ramp, Speed, advance, progress, reference, turns


class _Piece(NamedTuple):
    """A stretch of constant curvature [1/m] that begins `start` metres into the turn."""

    start: float
    pose: Pose
    curvature: float


@lru_cache(maxsize=16)
def _pieces(radius: float, straight: float) -> tuple[tuple[_Piece, ...], float]:
    """The pieces of one turn, last one first, and the length of the turn [m]."""
    half = straight / 2
    arc = radius * (2 * pi - 2 * atan(half / radius))
    pieces, start, pose = [], 0.0, Pose(0.0, 0.0, atan(radius / half))
    right, left = (arc, -1 / radius), (arc, 1 / radius)
    for length, curvature in ((half, 0.0), right, (straight, 0.0), left, (half, 0.0)):
        pieces.append(_Piece(start, pose, curvature))
        start, pose = start + length, advance(pose, curvature, length)
    return tuple(reversed(pieces)), start


class FigureEight(Spec):
    """Whole turns of an 8; the defaults take 119.7 s a turn."""

    kind: Literal["figure_eight"] = "figure_eight"
    radius_m: Positive = 10.0
    """Radius of the arcs [m]; estimate: 8-10 m fits the paper's 120 s a turn."""
    straight_m: Positive = 28.0
    """Length of each straight, from arc to arc [m]; estimate: 119.7 s a turn with the other defaults."""
    speed_m_s: Speed = 1.2
    """Speed of the reference [m/s]; estimate: 1-1.5 m/s fits the paper's 120 s a turn."""
    ramp_s: Ramp = RAMP_S
    """Time over which the speed rises from rest; 0: at once [s]. Estimate."""
    run_in_m: NonNegative = 14.0
    """Way to the crossing before the first turn begins, at most half a straight [m]. Estimate."""
    turns: Annotated[int, Field(ge=1, le=1000)] = 2
    """How often to go round [-]; paper."""

    @model_validator(mode="after")
    def _run_in_fits(self) -> Self:
        if self.run_in_m > self.straight_m / 2:
            raise ValueError(f"run_in_m: must be at most half of straight_m ({self.straight_m / 2:g})")
        return self

    @property
    def turn_s(self) -> float:
        """Time of one turn at full speed [s]."""
        return _pieces(self.radius_m, self.straight_m)[1] / self.speed_m_s

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
        """Where the curvature is largest: the beginning of the first arc."""
        arc = _pieces(self.radius_m, self.straight_m)[0][-2]
        return Place(arc.pose.x, arc.pose.y, self.run_in_m + arc.start)

    def at(self, t: float) -> Reference:
        """The reference at time `t` [s] since the start; any `t`, the 8 goes on."""
        pieces, length = _pieces(self.radius_m, self.straight_m)
        moved, share = progress(t, self.ramp_s)
        distance = (self.speed_m_s * moved - self.run_in_m) % length
        start, pose, curvature = next(piece for piece in pieces if piece.start <= distance)
        return reference(advance(pose, curvature, distance - start), curvature, share * self.speed_m_s)
