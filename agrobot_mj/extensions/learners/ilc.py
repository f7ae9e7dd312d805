"""Iterative learning control: a map of the steering angle over the place, learned from lap to lap, beside any law.

What the feedback law has to correct at a place in one lap the map does beforehand in the next (`lap_map`): slope and
soil, which repeat with the place, but not noise. The lap is the distance after which the heading of the path comes
again: a turn of a figure eight, two passes of a field with their turns; where it never does, the whole path, and the
map is of use in the next run, which begins with it by `file`.
"""

from collections.abc import Sequence
from math import inf, isfinite, radians, sqrt
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import Situation
from agrobot_mj.control.lqr import Lqr
from agrobot_mj.core.learned import Learned
from agrobot_mj.core.signals import Column, Command
from agrobot_mj.core.spec import Positive
from agrobot_mj.extensions.learners.lap_map import LapState
from agrobot_mj.extensions.learners.laws import LawInside
from agrobot_mj.extensions.learners.learning import ANGLE_COLUMNS, AngleLearner, PlaceLearner

SETTLED_M = 10.0
"""Distance after a tick that may not be learned from, in which the feedback brings the tractor back: what it does there
repeats behind every tight turn, but no map of that place takes it away [m]. Assumed value (6-15): some lengths of
the law.
"""


class IlcState(NamedTuple):
    """Memory of `Ilc`."""

    inner: Any
    """State of the feedback law."""
    lap: LapState = LapState()
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
    """Whether the last tick will be learned from."""
    settled: float = 0.0
    """Distance since the last tick at the limit, beside the path or unsure of it [m]."""


class Ilc(AngleLearner, PlaceLearner):
    """Any law with a map of the steering angle by place beside it, learned from lap to lap."""

    kind: Literal["ilc"] = "ilc"
    label: ClassVar = "ILC"
    inner: Annotated[LawInside, Field(discriminator="kind")] = Lqr()
    """The feedback law, by its own `kind`; a kinematic one with the yaw controller of `[controller]`."""
    bound_deg: Annotated[float, Field(gt=0, le=45)] = 10.0
    """Maximum angle of the map [deg]. Assumed value (5-15): holds a side slope of 20 deg, and nothing larger is
    slip."""
    answer_s: Annotated[float, Field(ge=0, le=5)] = 0.4
    """Time after which the wheels have answered the map [s]. Assumed value (0.3-0.6): as `preview_s` of the inner
    laws."""
    max_offset_m: Positive = 0.5
    """Cross-track error above which it does not learn [m]. Assumed value (0.3-1): a way onto the path is no
    disturbance."""
    max_steer_lag_deg: Positive = 10.0
    """Difference of the measured angle from the last command above which it does not learn [deg]. Assumed value
    (5-15)."""
    quantity = "steer_learned"

    def init(self) -> IlcState:
        """Nothing learned yet, or what the file says from the first tick on."""
        return IlcState(self.inner.init())

    def update(self, state: IlcState, situation: Situation, dt: float) -> tuple[IlcState, Command]:
        """Return the feedback law and map; then what was corrected here is kept for the next lap."""
        e, route = situation.estimate, situation.route
        near = route.passed(situation.t) if state.s is None else state.s
        place = route.nearest(e.x, e.y, near, situation.t)
        if state.s is None:
            lap, length = self.begun(route, place.s)
            state = state._replace(lap=lap, length=length)
        ahead = self.map.value(state.lap, place.s, state.length)
        answered = self.map.value(state.lap, place.s - e.speed * self.answer_s, state.length)
        inner, command, feedback, learning = self.corrected(state, situation, ahead, answered, place.offset, dt)
        way = 0.0 if state.s is None else max(place.s - state.s, 0.0)
        settled = state.settled + way if learning else 0.0
        learning = learning and settled >= SETTLED_M
        bound = radians(self.bound_deg)
        lap = self.map.after(state.lap, place.s, state.length, place.offset, feedback if learning else None, bound)
        learning = learning and lap.learning
        return IlcState(inner, lap, place.s, state.length, command.steer, ahead, feedback, learning, settled), command

    def learned(self, state: IlcState) -> Learned:
        """Return the map for the next lap [rad]."""
        return self.map.learned(state.lap, state.length, radians(self.bound_deg), self.quantity)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Those of the inner law, the map's angle, whether it learns, and how the lap compares."""
        own = (
            *ANGLE_COLUMNS,
            Column("learning_lap", "-", "number of the lap, from 0"),
            Column("learning_returns", "-", "how often a map that was worse was given up for the best one"),
            Column("xte_here", "m", "cross-track error, root mean square over some 2 m"),
            Column("xte_best", "m", "cross-track error of the best lap, root mean square; null before it is known"),
        )
        return (*self.inner.columns, *own)

    def report(self, state: IlcState) -> Sequence[float]:
        """Return the values of `columns`."""
        lap = state.lap
        best = lap.best_rms if isfinite(lap.best_rms) else float("nan")
        judged = float(lap.lap), float(lap.returns), sqrt(lap.square), best
        return (*self.inner.report(state.inner), state.ahead, state.feedback, float(state.learning), *judged)
