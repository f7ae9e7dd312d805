"""Iterative learning control of an implement. The line of the tractor is shifted so that the implement is on the path.

Guidance of the tractor alone leaves errors of the implement: a trailer cuts bends, a seeder drifts down a slope. The
inner law (any other law, including `ilc`) follows a line at the offset `y(s)` to the left of the path. The offset is
learned from lap to lap (`lap_map`) from the implement's error at its own location. A towed implement follows its hitch
with a lag equal to its length. At long wavelengths, a shift therefore has its effect at the same location, and the
correction is not shifted in arc length.

The implement's own receiver (`sensors.implement_gnss`) measures its position. Without a receiver, the position is
computed with a tractrix behind the hitch, which models how an implement cuts bends and uses the tractor's sideslip.
"""

from collections.abc import Sequence
from math import atan, cos, inf, isfinite, nan, sin, sqrt
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import Route, Situation
from agrobot_mj.control.lqr import Lqr
from agrobot_mj.core.geometry import from_heading, wrap
from agrobot_mj.core.learned import Learned
from agrobot_mj.core.signals import Column, Command, PathPoint, Reference, Vector
from agrobot_mj.core.spec import Positive
from agrobot_mj.extensions.learners.ilc import Ilc
from agrobot_mj.extensions.learners.lap_map import LapMap, LapState
from agrobot_mj.extensions.learners.laws import LawInside
from agrobot_mj.extensions.learners.learning import PlaceLearner

SPREAD_M = 1.0
"""Arc-length step for slope and curvature of the shifted line [m]. Assumed value: half the width of the map filter."""


class Moved(NamedTuple):
    """Route that is shifted laterally from another route by an offset that varies along the path."""

    route: Route
    map_: LapMap  # Map of the lateral offset of the line along the path
    state: LapState
    length: float  # Length of one lap [m]

    def at(self, t: float) -> Reference:
        """Return the reference (pose, velocity and curvature) on the shifted line at time `t` [s]."""
        r = self.route.at(t)
        y, slope, bend = self._shape(self.route.distance_at(t))
        dx, dy = from_heading(r.yaw, 0.0, y)
        direction = -1.0 if cos(r.yaw) * r.vx + sin(r.yaw) * r.vy < 0.0 else 1.0
        yaw = wrap(r.yaw + direction * atan(slope))
        speed = direction * sqrt(r.vx**2 + r.vy**2)
        vx, vy = from_heading(yaw, speed, 0.0)
        return r._replace(x=r.x + dx, y=r.y + dy, vx=vx, vy=vy, yaw=yaw, curvature=r.curvature + bend)

    def nearest(self, x: float, y: float, near: float, t: float) -> PathPoint:
        """Return the point of the shifted line at the arc length of the path point nearest to (x, y) [m]."""
        place = self.route.nearest(x, y, near, t)
        moved = self._moved(place)
        return moved._replace(offset=place.offset - self._shape(place.s)[0])

    def ahead(self, s: float) -> PathPoint:
        """Return the point of the shifted line at arc length `s` of the path [m]."""
        return self._moved(self.route.ahead(s))

    def curvatures(self, distances: Sequence[float] | Vector) -> Vector:
        """Return the curvatures of the shifted line [1/m] at the path arc lengths `distances` [m]."""
        found = self.route.curvatures(distances)
        for k, s in enumerate(distances):
            found[k] += self._shape(float(s))[2]
        return found

    def leg(self, t: float) -> tuple[float, float]:
        """Return the start and end [m] of the leg (between two reversals) of the original path that the reference
        travels at time `t` [s]."""
        return self.route.leg(t)

    def distance_at(self, t: float) -> float:
        """Return the arc length that the reference has travelled on the original path at time `t` [m]."""
        return self.route.distance_at(t)

    def lap(self) -> float:
        """Return the length of one lap of the original path [m]."""
        return self.length

    def _moved(self, place: PathPoint) -> PathPoint:
        y, slope, bend = self._shape(place.s)
        dx, dy = from_heading(place.yaw, 0.0, y)
        yaw = wrap(place.yaw + place.direction * atan(slope))
        return place._replace(x=place.x + dx, y=place.y + dy, yaw=yaw, curvature=place.curvature + bend)

    def _shape(self, s: float) -> tuple[float, float, float]:
        """Return offset [m], slope [-] and curvature [1/m] of the shifted line relative to the path at arc length `s`
        [m]."""
        behind, here, before = (self.map_.value(self.state, s + d, self.length) for d in (-SPREAD_M, 0.0, SPREAD_M))
        return here, (before - behind) / (2 * SPREAD_M), (before - 2 * here + behind) / SPREAD_M**2


class ImplementIlcState(NamedTuple):
    """State of the guidance law `ImplementIlc` between two ticks."""

    inner: Any
    lap: LapState = LapState()
    s: float | None = None  # Arc length of the path point nearest to the implement [m], or None before the first tick
    length: float = inf  # Length of one lap [m]
    yaw: float = nan  # Heading of the implement from the tractrix [rad], or NaN before the first tick
    offset: float = nan  # Offset of the implement from the path [m], left positive
    beside: float = 0.0  # Offset of the shifted line of the tractor from the path [m], left positive
    learning: bool = False  # Whether the last tick is used for learning


class ImplementIlc(PlaceLearner):
    """Guidance law whose inner law follows a line with a learned lateral shift that keeps the implement on the path."""

    kind: Literal["implement_ilc"] = "implement_ilc"
    label: ClassVar = "ILC of the implement"
    inner: Annotated[LawInside | Ilc, Field(discriminator="kind")] = Lqr()
    """Inner law, which follows the shifted line, selected by its own `kind`."""
    bound_m: Annotated[float, Field(gt=0, le=3)] = 0.5
    """Maximum offset of the shifted line [m]. Assumed value (range 0.2-1): a trailer cuts bends of 5 m radius by 0.4
    m."""
    max_offset_m: Positive = 1.0
    """Offset of the implement from the path above which learning is suspended [m]. Assumed value (range 0.5-2)."""
    tool_behind_m: Positive = 2.0
    """Distance from hitch to working point, for the tractrix [m]. Assumed value, equal to the default of `drawn`
    implements."""
    axle_behind_m: Positive = 2.0
    """Distance from hitch to implement axle, for the tractrix [m]. Assumed value, equal to the default of `drawn`
    implements."""
    quantity = "line_learned"

    def init(self) -> ImplementIlcState:
        """Return the initial state, before the first tick."""
        return ImplementIlcState(self.inner.init())

    def update(self, state: ImplementIlcState, situation: Situation, dt: float) -> tuple[ImplementIlcState, Command]:
        """Return the new state and the command of the inner law, which follows the shifted line. The offset of the
        implement from the path updates the shift."""
        e, route, t = situation.estimate, situation.route, situation.t
        x, y, yaw = self._implement(state, situation, dt)
        near = route.nearest(x, y, route.distance_at(t), t).s if state.s is None else state.s
        place = route.nearest(x, y, near, t)
        if state.s is None:
            lap, length = self.begin(route, place.s)
            state = state._replace(lap=lap, length=length)
        sound = self.sound(e, place.offset)
        correction = -place.offset if sound else None
        lap = self.map.after(state.lap, place.s, state.length, place.offset, correction, self.bound_m)
        line = Moved(route, self.map, lap, state.length)
        seen = situation._replace(route=line, reference=line.at(t))
        inner, command = self.inner.update(state.inner, seen, dt)
        beside = self.map.value(lap, route.distance_at(t), state.length)
        learning = sound and lap.learning
        return ImplementIlcState(inner, lap, place.s, state.length, yaw, place.offset, beside, learning), command

    def _implement(self, state: ImplementIlcState, situation: Situation, dt: float) -> tuple[float, float, float]:
        """Return the position of the implement x, y [m], which is measured or computed with the tractrix, and the
        heading of the tractrix [rad]."""
        e, m, (x, y) = situation.estimate, situation.machine, situation.implement
        heading = wrap(e.yaw - e.sideslip)
        yaw, behind = heading if state.yaw != state.yaw else state.yaw, m.hitch_behind_m
        bend = wrap(heading - yaw)
        across = e.speed * sin(bend) - behind * e.yaw_rate * cos(bend)  # hitch velocity to the left of the implement
        yaw = wrap(yaw + dt * across / self.axle_behind_m)
        if isfinite(x + y):
            return x, y, yaw
        x = e.rear_x - behind * cos(heading) - self.tool_behind_m * cos(yaw)
        y = e.rear_y - behind * sin(heading) - self.tool_behind_m * sin(yaw)
        return x, y, yaw

    def feedback(self, state: ImplementIlcState, command: Command) -> float:
        """Return the steering angle that the inner law adds by feedback [rad]."""
        return self.inner.feedback(state.inner, command)

    def learned(self, state: ImplementIlcState) -> Learned:
        """Return the map of the lateral offset of the shifted line for the next lap [m], and the quantities learned by
        the inner law."""
        return {
            **self.inner.learned(state.inner),
            **self.map.learned(state.lap, state.length, self.bound_m, self.quantity),
        }

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the inner law, of the shifted line, and of the implement's offset from the path."""
        own = (
            Column(self.quantity, "m", "learned offset of the tractor's line from the path, left positive"),
            Column("implement_offset_hat", "m", "offset of the implement used for learning, left positive"),
            Column("line_learning", "-", "1 while the line is learned, else 0"),
            Column("line_returns", "-", "number of times a worse line was replaced by the best one"),
        )
        return (*self.inner.columns, *own)

    def report(self, state: ImplementIlcState) -> Sequence[float]:
        """Return the values of the log columns for a state, in the order of `columns`."""
        own = state.beside, state.offset, float(state.learning), float(state.lap.returns)
        return (*self.inner.report(state.inner), *own)
