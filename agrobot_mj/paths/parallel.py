"""Work on a field: parallel straight passes, driven to and fro, with a turn at either end.

A `Parallel` says where its first pass heads and on which side the others lie. `headland.py` has the turns: `u`, `omega`
and `k`. Closer neighbours than a `u` can join are left for later: it goes on n passes farther and comes back n + 1,
n = width of the turn / swath rounded up, in blocks of 2 n + 1.

The field ends where the passes end: turns lie outside. After the last pass the tractor leaves the field straight on.
`passes_s` gives the times between which each pass counts: the first `run_in_m` metres, in which the tractor swings in,
do not.
"""

from collections.abc import Iterator
from itertools import pairwise
from math import ceil
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from agrobot_mj.core.spec import HUGE, NonNegative, Positive
from agrobot_mj.paths.arc import Pose, Speed
from agrobot_mj.paths.headland import half_turn_width, headland_turn
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.track import Course, Piece, chain
from agrobot_mj.paths.transition import Transitions

Count = Annotated[int, Field(ge=1, le=1000)]
LEAVE_M = 5.0
"""Straight on after the last pass, so that a tractor behind its time ends it too [m]."""
Coordinate = Annotated[float, Field(ge=-HUGE, le=HUGE)]


class Parallel(Transitions, Timed):
    """Parallel passes; a kind says which way they run. Width and radius that are not given grow with the machine."""

    sized: ClassVar = {**Transitions.sized, "swath_m": {"width": 1}, "turn_radius_m": {"turn": 1}}
    radius_key: ClassVar = "turn_radius_m"

    length_m: Positive = 100.0
    """Length of a pass [m]; assumed value: a field of 1 ha is 100 m by 100 m."""
    swath_m: Positive = 2.0
    """Working width: from each pass to its neighbour [m]. When left out it is `implement.width_m`, where that is given,
    else it grows with the track. Assumed value (1.5-2.5): implements of compact tractors."""
    count: Count = 4
    """Number of passes [-]; assumed value: a small field."""
    turn: Literal["u", "omega", "k"] = "omega"
    """Shape of the turns between close passes: left for later (`u`), a bulb, or three arcs with a piece in reverse."""
    turn_radius_m: Positive = 3.0
    """Radius of all arcs of a turn [m]. When left out it grows with the turning circle. Assumed value (2.5-4): 25 deg
    of steering, half of what there is."""
    turn_speed_m_s: Speed = 1.0
    """Largest speed in a turn [m/s]. Assumed value (0.7-1.2): what a driver takes."""
    cusp_pause_s: NonNegative = 2.0
    """Standstill at each cusp of a `k` turn [s]. Assumed value (1-4): to change gear and turn the wheels."""
    run_in_m: NonNegative = 20.0
    """Beginning of each pass left out of `passes_s`, at most half of it [m]. Assumed value (10-30): it has swung in."""
    start_x_m: Coordinate = 0.0
    """Start of the first pass, east [m]."""
    start_y_m: Coordinate = 0.0
    """Start of the first pass, north [m]."""

    @property
    def lie(self) -> tuple[float, float]:
        """Direction of the first pass [rad] and the side on which the others lie: 1 left, -1 right."""
        raise NotImplementedError

    @property
    def order(self) -> tuple[int, ...]:
        """The passes, numbered from the first across the field, in the order in which they are driven.

        Raises ValueError where U turns leave no order.
        """
        width = half_turn_width(self.turn_radius_m, self.sharpness(self.turn_speed_m_s))
        across = ceil(width / self.swath_m - 1e-9)
        if self.turn != "u" or across <= 1:
            return tuple(range(self.count))
        if 1 < self.count < 2 * across + 1:
            raise ValueError(
                f"count: U turns of radius {self.turn_radius_m:g} m over swaths of {self.swath_m:g} m need 1 or at "
                f'least {2 * across + 1} passes, got {self.count}; set turn = "omega" or a smaller turn_radius_m'
            )
        return tuple(skipping(self.count, across))

    @property
    def passes_s(self) -> tuple[tuple[float, float], ...]:
        """(start, end) of each pass in the order in which they are driven, its run-in left out [s]."""
        pieces, motion, ends, way = self._pieces(), self.motion, [], 0.0
        for piece, is_pass in pieces:
            if is_pass:
                ends.append((motion.time_at(way + self.run_in_m), motion.time_at(way + piece.length)))
            way += piece.length
        return tuple(ends)

    def course(self) -> Course:
        """All passes and turns."""
        if self.run_in_m > self.length_m / 2:
            raise ValueError(f"run_in_m: must be at most half of length_m ({self.length_m / 2:g})")
        start = Pose(self.start_x_m, self.start_y_m, self.lie[0])
        return chain(start, (piece for piece, _ in self._pieces()), self.cusp_pause_s)

    def _pieces(self) -> Iterator[tuple[Piece, bool]]:
        """Each piece, and whether it is a pass."""
        side, order = self.lie[1], self.order
        turn = self.turn, self.turn_radius_m, self.sharpness(self.turn_speed_m_s), self.turn_speed_m_s
        yield Piece(self.length_m), True
        for k, (here, there) in enumerate(pairwise(order)):
            forth = 1 if k % 2 == 0 else -1
            for piece in headland_turn(side * forth * (there - here) * self.swath_m, *turn):
                yield piece, False
            yield Piece(self.length_m), True
        yield Piece(LEAVE_M), False


def skipping(count: int, across: int) -> Iterator[int]:
    """An order of `count` passes, at least 2 `across` + 1, of which none follows one that is less than `across` away.

    Blocks of 2 `across` + 1 go on by `across`, or back by one more; the rest at the end takes its two halves by turns.
    """
    block, first = 2 * across + 1, 0
    while first < count:
        rest = count - first
        size = block if rest == block or rest >= 2 * block else rest
        if size == block:
            yield from (first + k * across % block for k in range(block))
        else:
            half = -(-size // 2)
            yield from (first + k // 2 + half * (k % 2) for k in range(size))
        first += size
