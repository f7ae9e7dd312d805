"""Iterative learning control: a map of the steering angle over the place, learnt from lap to lap, beside any law.

What the feedback law has to correct at a place in one lap the map does beforehand in the next (`lap_map`): slope, soil
and ruts, which repeat with the place, but not noise. The lap is the distance after which the heading of the path comes
again: a turn of a figure eight, two passes of a field with their turns; where it never does, the whole path, and the
map is of use in the next run, which begins with it by `file`.

The inner law sees the steering angle less what the map has made of it, so that it does not work against it. Ticks in
which the command is at its limit, the wheels are far behind it or the position is uncertain are not learnt from.
"""

from collections.abc import Sequence
from math import inf, isfinite, radians, sqrt
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import LawAround, Situation
from agrobot_mj.control.lap_map import LapMap, LapState
from agrobot_mj.control.laws import InnerLaw
from agrobot_mj.control.lqr import Lqr
from agrobot_mj.control.pid import clip
from agrobot_mj.core.learned import Learned, read_learned, require_quantity
from agrobot_mj.core.signals import Column, Command, Estimate
from agrobot_mj.core.spec import NonNegative, Positive

STEER = "steer_learned"
"""Name of the map, in the log and in files."""


class IlcState(NamedTuple):
    """Memory of `Ilc`."""

    inner: Any
    """State of the feedback law."""
    lap: LapState = LapState()
    """The map."""
    s: float | None = None
    """Distance of the nearest point along the path; None before the first tick [m]."""
    length: float = inf
    """Length of a lap [m]."""
    steer: float = 0.0
    """Last command [rad]."""
    ahead: float = 0.0
    """Angle that the map gave in the last tick [rad]."""
    feedback: float = 0.0
    """Angle that the feedback law added [rad]."""
    learning: bool = False
    """Whether the last tick will be learnt from."""


class Ilc(LawAround):
    """Any law with a map of the steering angle by place beside it, learnt from lap to lap."""

    kind: Literal["ilc"] = "ilc"
    inner: Annotated[InnerLaw, Field(discriminator="kind")] = Lqr()
    """The feedback law, by its own `kind`; a kinematic one with the yaw controller of `[controller]`."""
    map: LapMap = LapMap()
    """The map and its learning."""
    file: Annotated[str, Field(min_length=1)] | None = None
    """Map to begin with, `learned.parquet` of a run on the same path; none when left out."""
    bound_deg: Annotated[float, Field(gt=0, le=45)] = 10.0
    """Largest angle of the map [deg]. Estimate (5-15): holds a side slope of 20 deg, and nothing larger is slip."""
    answer_s: Annotated[float, Field(ge=0, le=5)] = 0.4
    """Time after which the wheels have answered the map [s]. Estimate (0.3-0.6): as `preview_s` of the inner laws."""
    max_offset_m: Positive = 0.5
    """Cross-track error beyond which it does not learn [m]. Estimate (0.3-1): a way onto the path is no disturbance."""
    max_sigma_m: Positive = 0.1
    """Estimated position error beyond which it does not learn [m]. Estimate (0.05-0.3): between RTK and float."""
    min_speed_m_s: NonNegative = 0.3
    """Forward speed below which it does not learn [m/s]. Estimate (0.1-0.5)."""
    max_steer_lag_deg: Positive = 10.0
    """Difference of the measured angle from the last command beyond which it does not learn [deg]. Estimate (5-15)."""
    holds_lane_change: ClassVar = True

    def check(self) -> None:
        """Read the file. Raises ValueError."""
        self.inner.check()
        if self.file is not None:
            require_quantity(self.file, STEER)

    def init(self) -> IlcState:
        """Nothing learnt yet, or what the file says from the first tick on."""
        return IlcState(self.inner.init())

    def update(self, state: IlcState, situation: Situation, dt: float) -> tuple[IlcState, Command]:
        """Feedback law and map; then what was corrected here is kept for the next lap."""
        e, route = situation.estimate, situation.route
        near = route.passed(situation.t) if state.s is None else state.s
        place = route.nearest(e.x, e.y, near, situation.t)
        if state.s is None:
            known = None if self.file is None else read_learned(self.file)
            state = state._replace(length=(length := route.lap()), lap=self.map.begun(place.s, length, known, STEER))
        ahead = self.map.value(state.lap, place.s, state.length)
        answered = self.map.value(state.lap, place.s - e.speed * self.answer_s, state.length)
        inner, command = self.inner.update(state.inner, situation._replace(steer=situation.steer - answered), dt)
        feedback, wanted, limit = (
            self.inner.feedback(inner, command),
            command.steer + ahead,
            situation.machine.steer_limit,
        )
        free = max(abs(command.steer), abs(wanted)) < limit and command.steer_voltage is None
        answers = abs(situation.steer - state.steer) <= radians(self.max_steer_lag_deg)
        learning = free and answers and self._sound(e, place.offset)
        bound = radians(self.bound_deg)
        lap = self.map.after(state.lap, place.s, state.length, place.offset, feedback if learning else None, bound)
        steer = clip(wanted, -limit, limit)
        learning = learning and lap.learning
        state = IlcState(inner, lap, place.s, state.length, steer, ahead, feedback, learning)
        return state, command._replace(steer=steer)

    def _sound(self, e: Estimate, offset: float) -> bool:
        """Whether the tractor drives near its path and knows where it is."""
        sigma = sqrt(max(e.covariance[0, 0], e.covariance[1, 1], 0.0))
        known = e.aligned and sigma <= self.max_sigma_m
        return known and abs(offset) <= self.max_offset_m and e.speed >= self.min_speed_m_s

    def feedback(self, state: IlcState, command: Command) -> float:
        """What the inner law adds to the map [rad]."""
        return state.feedback

    def learned(self, state: IlcState) -> Learned:
        """The map for the next lap [rad]."""
        return self.map.learned(state.lap, state.length, radians(self.bound_deg), STEER)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Those of the inner law, the map's angle, whether it learns, and how the lap compares."""
        own = (
            Column(STEER, "rad", "steering angle of the learnt map, left positive"),
            Column("steer_feedback", "rad", "steering angle that the feedback law added, left positive"),
            Column("learning", "-", "1 while the map learns, else 0"),
            Column("learning_lap", "-", "number of the lap, from 0"),
            Column("learning_returns", "-", "how often a map that was worse was given up for the best one"),
            Column("xte_here", "m", "cross-track error, root mean square over some 2 m"),
            Column("xte_best", "m", "cross-track error of the best lap, root mean square; null before it is known"),
        )
        return (*self.inner.columns, *own)

    def report(self, state: IlcState) -> Sequence[float]:
        """Values of `columns`."""
        lap = state.lap
        best = lap.best_rms if isfinite(lap.best_rms) else float("nan")
        judged = float(lap.lap), float(lap.returns), sqrt(lap.square), best
        return (*self.inner.report(state.inner), state.ahead, state.feedback, float(state.learning), *judged)
