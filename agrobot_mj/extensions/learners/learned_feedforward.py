"""Feedforward learned without a model, added to any feedback law: delta = delta_feedback + f . w(path).

A network (`path_network`) maps the path ahead (curvature, speed and, with an inertial unit, roll of the ground) to a
steering angle. It learns from the angle of the feedback law: repeated corrections at the same curvature move into the
map. This is feedback-error learning as in the paper, with the path as input instead of the error, so that the map
applies when the same curvature returns. The inner law receives the steering angle minus the contribution of the map, so
that a law with a steering state does not counteract the map.

Learning is suspended while the command is at its limit, the wheels lag behind the command or the position is uncertain
(dead reckoning, no RTK solution), and also away from the path, near standstill and in reverse. The map remains active.
It cannot learn effects that are absent from its inputs: a side slope without an inertial unit, a worn valve, wind.
"""

from collections.abc import Sequence
from math import isnan, radians, sqrt
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import Situation
from agrobot_mj.control.kinematic import Kinematic
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.signals import Column, Command
from agrobot_mj.core.spec import Positive
from agrobot_mj.extensions.learners.laws import LawInside
from agrobot_mj.extensions.learners.learning import ANGLE_COLUMNS, AngleLearner
from agrobot_mj.extensions.learners.path_network import PathInput, PathNetwork, PathNetworkState


class LearnedState(NamedTuple):
    """State of `LearnedFeedforward`."""

    inner: Any
    network: PathNetworkState
    """Map after the learning step of this tick."""
    steer: float = 0.0
    """Last commanded steering angle [rad]."""
    feedforward: float = 0.0
    """Steering angle from the map in the last tick [rad]."""
    feedback: float = 0.0
    """Steering angle added by the feedback law [rad]."""
    learning: bool = False
    """Whether the last tick was used for learning."""


class LearnedFeedforward(AngleLearner):
    """Any feedback law plus a map from the path to the steering angle, learned during the run."""

    kind: Literal["learned_feedforward"] = "learned_feedforward"
    label: ClassVar = "learned feedforward"
    inner: Annotated[LawInside, Field(discriminator="kind")] = Kinematic()
    """Feedback law, selected by its own `kind`. A kinematic law uses the yaw controller of `[controller]`."""
    network: PathNetwork = PathNetwork()
    """Map from the path to the steering angle and its learning rule."""
    preview_s: Annotated[float, Field(ge=0, le=5)] = 0.3
    """Preview time of the path ahead of the reference [s]. Assumed value (0.2-0.6): as in `feedforward`."""
    bound_deg: Annotated[float, Field(gt=0, le=45)] = 35.0
    """Maximum consequent of the map [deg]. Assumed value (5-45): an arc of 2 m; less with another feedforward."""
    max_offset_m: Positive = 2.0
    """Lateral error above which learning is suspended [m]. Assumed value (0.5-3): the supervisor's limit."""
    max_steer_lag_deg: Positive = 6.0
    """Difference between measured and last commanded angle above which learning is suspended [deg]. Assumed value
    (3-10): about 2 on an arc; feedback is meaningless while the valve moves."""
    tunable: ClassVar = {"network.eta": (0.02, 1.0)}
    """Search range of the learning rate, in addition to the gains of the yaw controller."""
    tuned: ClassVar = {
        "learned_feedforward with pd": {
            "guidance.inner.scheduled_above_m_s": 1.5,
            "guidance.network.eta": 0.79,
            "controller.kp": 0.82,
            "controller.kd": 0.15,
        }
    }

    def init(self) -> LearnedState:
        """Return the initial state, with an empty map."""
        return LearnedState(self.inner.init(), self.network.init())

    def update(self, state: LearnedState, situation: Situation, dt: float) -> tuple[LearnedState, Command]:
        """Return the command of feedback law plus map, and update the map from the feedback."""
        w, map_ = self.network.firing(self.inputs(situation)), state.network
        ahead, answered = float(map_.f @ w), float(map_.f @ map_.trace)
        e, r = situation.estimate, situation.reference
        offset = to_heading(r.yaw, r.x - e.x, r.y - e.y)[1]
        inner, command, feedback, learning = self.corrected(state, situation, ahead, answered, offset, dt)
        if learning:
            map_ = self.network.learnt(map_, feedback, radians(self.bound_deg), dt)
        map_ = self.network.remembered(map_, w, dt)
        return LearnedState(inner, map_, command.steer, ahead, feedback, learning), command

    def inputs(self, situation: Situation) -> PathInput:
        """Return the inputs of the map: curvature [1/m], speed [m/s] and roll [rad], 0 without a measurement."""
        ahead = situation.route.at(situation.t + self.preview_s)
        roll = 0.0 if isnan(situation.roll) else situation.roll
        return PathInput(ahead.curvature, sqrt(ahead.vx**2 + ahead.vy**2), roll)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the inner law, the map angle, the learning flag and all consequents."""
        names = [_rule(i, self.network.shape) for i in range(len(self.network.init().f))]
        weights = [Column(f"map_{name}", "rad", f"consequent of rule {name}: curvature, speed, roll") for name in names]
        return (*self.inner.columns, *ANGLE_COLUMNS, *weights)

    def report(self, state: LearnedState) -> Sequence[float]:
        """Return the values of `columns`."""
        own = (state.feedforward, state.feedback, float(state.learning))
        return (*self.inner.report(state.inner), *own, *state.network.f.tolist())


def _rule(number: int, shape: tuple[int, int, int]) -> str:
    curvature, rest = divmod(number, shape[1] * shape[2])
    return f"{curvature}_{rest // shape[2]}_{rest % shape[2]}"
