"""Field work: parallel straight passes in alternating directions, with a turn at each end.

A subclass of `Parallel` defines the direction of the first pass and the side of the other passes. `headland.py` defines
the turns `u`, `omega` and `k`. With `u` turns, passes closer than the turn width are skipped and worked later. The
tractor then advances by n passes and returns by n + 1, in blocks of 2 n + 1 passes. The number n is the turn width
divided by the swath width, rounded up.

The field ends at the ends of the passes; the turns are outside. After the last pass the tractor continues straight.
`passes_s` contains the time interval of each pass without its first `run_in_m` metres, where errors of the turn decay.
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
LEAVE_M = 5.0  # Straight distance after the last pass [m], in which a tractor behind its reference completes the pass
Coordinate = Annotated[float, Field(ge=-HUGE, le=HUGE)]


class Parallel(Transitions, Timed):
    """Base class of paths with parallel passes; subclasses define `orientation`."""

    sized: ClassVar = {**Transitions.sized, "swath_m": {"width": 1}, "turn_radius_m": {"turn": 1}}
    radius_key: ClassVar = "turn_radius_m"

    length_m: Positive = 100.0
    """Length of a pass [m]. Assumed value; a field of 1 ha is 100 m by 100 m."""
    swath_m: Positive = 2.0
    """Working width: distance between adjacent passes [m]. Default: `implement.width_m` if set, else proportional to
    the track width. Assumed value (range 1.5-2.5) for implements of compact tractors."""
    count: Count = 4
    """Number of passes [-]. Assumed value for a small field."""
    turn: Literal["u", "omega", "k"] = "omega"
    """Shape of turns between close passes: half turn to a more distant pass (`u`), bulb (`omega`), or three arcs
    (`k`)."""
    turn_radius_m: Positive = 3.0
    """Radius of all arcs of a turn [m]. Default: proportional to the turning circle. Assumed value: 3 m (range 2.5-4),
    which requires a steering angle of 25 deg, half of the maximum."""
    turn_speed_m_s: Speed = 1.0
    """Maximum speed in a turn [m/s]. Assumed value (range 0.7-1.2) for typical drivers."""
    cusp_pause_s: NonNegative = 2.0
    """Duration of the standstill at each cusp of a `k` turn [s]. Assumed value (range 1-4) for changing gear and
    turning the wheels."""
    run_in_m: NonNegative = 20.0
    """Initial length of each pass that `passes_s` excludes [m], at most half of the pass. Assumed value (range
    10-30)."""
    start_x_m: Coordinate = 0.0
    """East coordinate of the start of the first pass [m]."""
    start_y_m: Coordinate = 0.0
    """North coordinate of the start of the first pass [m]."""

    @property
    def orientation(self) -> tuple[float, float]:
        """Direction of the first pass [rad], and the side of the other passes: 1 for left, -1 for right."""
        raise NotImplementedError

    @property
    def order(self) -> tuple[int, ...]:
        """Pass numbers in the order of travel. Passes are numbered across the field, from 0 for the first pass."""
        width = half_turn_width(self.turn_radius_m, self.sharpness(self.turn_speed_m_s))
        across = ceil(width / self.swath_m - 1e-9)
        if self.turn != "u" or across <= 1:
            return tuple(range(self.count))
        if 1 < self.count < 2 * across + 1:
            raise ValueError(
                f"count: U turns of radius {self.turn_radius_m:g} m with swaths of {self.swath_m:g} m need 1 or at "
                f'least {2 * across + 1} passes, got {self.count}; set turn = "omega" or a smaller turn_radius_m'
            )
        return tuple(skipping(self.count, across))

    @property
    def passes_s(self) -> tuple[tuple[float, float], ...]:
        """Start and end times of each pass without its run-in [s], in the order of travel."""
        pieces, motion, ends, distance = self._pieces(), self.motion, [], 0.0
        for piece, is_pass in pieces:
            if is_pass:
                ends.append((motion.time_at(distance + self.run_in_m), motion.time_at(distance + piece.length)))
            distance += piece.length
        return tuple(ends)

    def course(self) -> Course:
        """Return the geometry of the path along all passes and turns."""
        if self.run_in_m > self.length_m / 2:
            raise ValueError(f"run_in_m: must be at most half of length_m ({self.length_m / 2:g} m)")
        start = Pose(self.start_x_m, self.start_y_m, self.orientation[0])
        return chain(start, (piece for piece, _ in self._pieces()), self.cusp_pause_s)

    def _pieces(self) -> Iterator[tuple[Piece, bool]]:
        side, order = self.orientation[1], self.order
        turn = self.turn, self.turn_radius_m, self.sharpness(self.turn_speed_m_s), self.turn_speed_m_s
        yield Piece(self.length_m), True
        for k, (here, there) in enumerate(pairwise(order)):
            forth = 1 if k % 2 == 0 else -1
            for piece in headland_turn(side * forth * (there - here) * self.swath_m, *turn):
                yield piece, False
            yield Piece(self.length_m), True
        yield Piece(LEAVE_M), False


def skipping(count: int, across: int) -> Iterator[int]:
    """Yield `count` pass numbers in an order with steps of at least `across`; `count` is at least 2 `across` + 1.

    Within a block of 2 `across` + 1 passes, each step goes forward by `across` or back by `across` + 1. The last
    passes, which do not fill a block, alternate between their first and second half.
    """
    block, first = 2 * across + 1, 0
    while first < count:
        remaining = count - first
        size = block if remaining == block or remaining >= 2 * block else remaining
        if size == block:
            yield from (first + k * across % block for k in range(block))
        else:
            half = -(-size // 2)
            yield from (first + k // 2 + half * (k % 2) for k in range(size))
        first += size
