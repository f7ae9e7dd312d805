"""Iterative learning control. A map of the steering angle along the path is learned from lap to lap and added to any
law.

Corrections that the feedback law makes at a location in one lap are applied in advance in the next lap (`lap_map`). The
map thus compensates effects that repeat with the location, for example of slope and soil. Noise is averaged out. A lap
ends where the sequence of path headings repeats: after one round of a figure eight, or two passes of a field. On a path
without repetition, the lap is the complete path, and the next run loads the map from `file`.
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
"""Distance without learning after a tick that is unsuitable for learning [m]. Assumed value (range 6-15): the tractor
returns to the path in this distance. A map cannot remove the corrections that repeat after every tight turn.
"""


class IlcState(NamedTuple):
    """State of the guidance law `Ilc` between two ticks."""

    inner: Any
    lap: LapState = LapState()
    s: float | None = None  # Arc length of the nearest point of the path [m], or None before the first tick
    length: float = inf  # Length of a lap [m]
    steer: float = 0.0  # Last commanded steering angle [rad]
    ahead: float = 0.0  # Steering angle of the map in the last tick [rad]
    feedback: float = 0.0  # Steering angle added by the feedback law [rad]
    learning: bool = False  # Whether the last tick was used for learning
    settled: float = 0.0
    """Distance travelled since the last tick with saturated steering, a large offset or an uncertain position [m]."""


class Ilc(AngleLearner, PlaceLearner):
    """Guidance law that adds a map of the steering angle, learned from lap to lap, to the command of any other law."""

    kind: Literal["ilc"] = "ilc"
    label: ClassVar = "ILC"
    inner: Annotated[LawInside, Field(discriminator="kind")] = Lqr()
    """Feedback law, selected by its own `kind`. A kinematic law uses the yaw controller of `[controller]`."""
    bound_deg: Annotated[float, Field(gt=0, le=45)] = 10.0
    """Maximum magnitude of the map [deg]. Assumed value (range 5-15): sufficient for a side slope of 20 deg."""
    answer_s: Annotated[float, Field(ge=0, le=5)] = 0.4
    """Time until the wheels respond to the map [s]. Assumed value (range 0.3-0.6), like `preview_s` of other laws."""
    max_offset_m: Positive = 0.5
    """Cross-track error above which learning is suspended [m]. Assumed value (range 0.3-1), to exclude path
    acquisition."""
    max_steer_lag_deg: Positive = 10.0
    """Difference between measured and commanded steering angle [deg] above which learning is suspended. Assumed value
    (range 5-15)."""
    quantity = "steer_learned"

    def init(self) -> IlcState:
        """Return the initial state of the law. The map is initialized in the first tick."""
        return IlcState(self.inner.init())

    def update(self, state: IlcState, situation: Situation, dt: float) -> tuple[IlcState, Command]:
        """Return the new state and the command of the feedback law plus the learned angle of the lap map. The
        correction at this location is stored for the next lap."""
        e, route = situation.estimate, situation.route
        near = route.distance_at(situation.t) if state.s is None else state.s
        place = route.nearest(e.x, e.y, near, situation.t)
        if state.s is None:
            lap, length = self.begin(route, place.s)
            state = state._replace(lap=lap, length=length)
        ahead = self.map.value(state.lap, place.s, state.length)
        answered = self.map.value(state.lap, place.s - e.speed * self.answer_s, state.length)
        inner, command, feedback, learning = self.correct(state, situation, ahead, answered, place.offset, dt)
        way = 0.0 if state.s is None else max(place.s - state.s, 0.0)
        settled = state.settled + way if learning else 0.0
        learning = learning and settled >= SETTLED_M
        bound = radians(self.bound_deg)
        lap = self.map.after(state.lap, place.s, state.length, place.offset, feedback if learning else None, bound)
        learning = learning and lap.learning
        return IlcState(inner, lap, place.s, state.length, command.steer, ahead, feedback, learning, settled), command

    def learned(self, state: IlcState) -> Learned:
        """Return the map of the steering angle for the next lap [rad], and the map and the error of the best lap, by
        arc length [m]."""
        return self.map.learned(state.lap, state.length, radians(self.bound_deg), self.quantity)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the inner law, of the map angle, of the learning flag, and of the comparison between laps."""
        own = (
            *ANGLE_COLUMNS,
            Column("learning_lap", "-", "number of the lap, from 0"),
            Column("learning_returns", "-", "number of times a worse map was replaced by the best one"),
            Column("xte_here", "m", "cross-track error, root mean square over about 2 m"),
            Column("xte_best", "m", "cross-track error of the best lap, root mean square; null before it is known"),
        )
        return (*self.inner.columns, *own)

    def report(self, state: IlcState) -> Sequence[float]:
        """Return the values of the log columns for a state, in the order of `columns`."""
        lap = state.lap
        best = lap.best_rms if isfinite(lap.best_rms) else float("nan")
        judged = float(lap.lap), float(lap.returns), sqrt(lap.square), best
        return (*self.inner.report(state.inner), state.ahead, state.feedback, float(state.learning), *judged)
