"""Base classes of guidance laws that consist of an inner law and a learned part.

A tick is used for learning if the tractor moves near its path and its position is accurate. Learning of a steering
angle is also suspended while the command is at its limit or the wheels lag far behind the command, because the feedback
then contains no information about the learned angle. The inner law receives the steering angle minus the learned angle,
so that it does not counteract the learned angle.
"""

from math import radians, sqrt
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import GuidanceLaw, Route, Situation, YawController
from agrobot_mj.control.pid import clip
from agrobot_mj.core.learned import LEARNED, read_learned
from agrobot_mj.core.resources import refuse
from agrobot_mj.core.signals import Column, Command, Estimate
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.extensions.learners.lap_map import LapMap, LapState


class LearningLaw(GuidanceLaw):
    """Base class of guidance laws that consist of an inner law and a learned part."""

    inner: GuidanceLaw
    """Inner law, which is a complete guidance law that the learned part extends."""
    max_offset_m: Positive
    """Lateral offset from the path above which learning is suspended [m]."""
    max_sigma_m: Positive = 0.1
    """Position standard deviation above which learning is suspended [m]. Assumed value (range 0.05-0.3), between RTK
    fixed and RTK float."""
    min_speed_m_s: NonNegative = 0.3
    """Minimum forward speed for learning [m/s]. Assumed value (range 0.1-0.5)."""
    holds_lane_change: ClassVar = True

    def using(self, controller: YawController) -> GuidanceLaw:
        """Return a copy of this law whose inner law uses the given yaw controller."""
        inner = self.inner.using(controller)
        return self if inner is self.inner else self.model_copy(update={"inner": inner})

    @property
    def follows_path(self) -> bool:
        """Whether the inner law follows the scenario path."""
        return self.inner.follows_path

    def sound(self, e: Estimate, offset: float) -> bool:
        """Return whether a tick is suitable for learning: the tractor moves forward near the path, and its position is
        accurate. `offset` is the lateral offset from the path [m]."""
        sigma = sqrt(max(e.covariance[0, 0], e.covariance[1, 1], 0.0))
        known = e.aligned and sigma <= self.max_sigma_m
        return known and abs(offset) <= self.max_offset_m and e.speed >= self.min_speed_m_s


def require_quantity(name: str, *quantities: str) -> None:
    """Raise ValueError for the key `file` unless the learned file `name` contains all `quantities`."""
    try:
        learned = read_learned(name)
        if missing := [quantity for quantity in quantities if quantity not in learned]:
            holds = ", ".join(learned) or "nothing"
            refuse(Path(name), f"the file has no {', '.join(missing)}, only {holds}; specify another {LEARNED}")
    except ValueError as error:
        raise ValueError(f"file: {error}") from None


class PlaceLearner(LearningLaw):
    """Base class of guidance laws that learn a quantity as a function of the arc length along the path."""

    map: LapMap = LapMap()
    """Map of the learned quantity along the path, with its update rule."""
    file: Annotated[str, Field(min_length=1)] | None = None
    """Initial map: `learned.parquet` of a run on the same path. Default: none."""
    quantity: ClassVar[str]
    """Name of the learned quantity in the log and in files."""

    def check(self) -> None:
        """Check the initial map in `file`. Raises ValueError for an invalid file."""
        self.inner.check()
        if self.file is not None:
            require_quantity(self.file, self.quantity)

    def begin(self, route: Route, s: float) -> tuple[LapState, float]:
        """Return the initial map state at arc length `s` [m] of a route, and the lap length [m]."""
        known = None if self.file is None else read_learned(self.file)
        return self.map.begin(s, length := route.lap(), known, self.quantity), length


class Corrected(NamedTuple):
    """Result of one tick of an inner law whose steering command is corrected by a learned angle."""

    inner: Any
    command: Command
    """Command with the steering angle of the inner law plus the learned angle, limited to the steering limit."""
    feedback: float  # Steering angle added by the inner law [rad]
    learning: bool  # Whether the tick may be used for learning


class AngleLearner(LearningLaw):
    """Base class of guidance laws that learn a steering angle. Their state classes need the fields `inner`, `steer` and
    `feedback`."""

    max_steer_lag_deg: Positive
    """Difference between measured and last commanded steering angle [deg] above which learning is suspended."""

    def correct(
        self, state: Any, situation: Situation, ahead: float, answered: float, offset: float, dt: float
    ) -> Corrected:
        """Return the command of the inner law plus the learned angle `ahead` [rad].

        The inner law receives the steering angle minus `answered` [rad], the learned angle that the wheels have
        reached.
        """
        inner, command = self.inner.update(state.inner, situation._replace(steer=situation.steer - answered), dt)
        wanted, limit = command.steer + ahead, situation.machine.steer_limit
        free = max(abs(command.steer), abs(wanted)) < limit and command.steer_voltage is None
        answers = abs(situation.steer - state.steer) <= radians(self.max_steer_lag_deg)
        learning = free and answers and self.sound(situation.estimate, offset)
        feedback = self.inner.feedback(inner, command)
        return Corrected(inner, command._replace(steer=clip(wanted, -limit, limit)), feedback, learning)

    def feedback(self, state: Any, command: Command) -> float:
        """Return the steering angle that the inner law adds by feedback [rad], without the learned angle."""
        return float(state.feedback)


ANGLE_COLUMNS = (
    Column("steer_learned", "rad", "steering angle of the learned map, left positive"),
    Column("steer_feedback", "rad", "steering angle added by the feedback law, left positive"),
    Column("learning", "-", "1 while the map learns, else 0"),
)
