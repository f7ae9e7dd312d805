"""Feedforward that is learned without a model and added to a feedback law: delta = delta_feedback + f . w(path).

A network (`PathNetwork`) maps the path ahead (curvature, speed and, with an inertial unit, roll of the ground) to a
steering angle. It learns from the angle of the feedback law: corrections that repeat at the same curvature are learned
by the network. This is feedback-error learning as in the paper, but with the path instead of the error as input, so
that learned angles are used again at the same curvature. The inner law receives the steering angle minus the learned
angle, so that a law with a steering state does not counteract it.

Learning is suspended while the command is at its limit, the wheels lag behind the command or the position is uncertain
(dead reckoning, no RTK solution), and also away from the path, near standstill and in reverse. The learned angle
remains active. The network cannot learn effects that do not depend on its inputs, for example a side slope without an
inertial unit, a worn valve, or wind.

Network: fixed interval type-2 fuzzy sets with learned consequents. Inputs are the curvature kappa [1/m] and speed u
[m/s] of the path ahead, and the roll phi of the ground [rad]. Triangular sets are evenly spaced over the range of each
input. The upper and lower widths of a set are (1 + uncertainty) and (1 - uncertainty) times the distance of the
centres. The output is linear in the consequents f:  y = f . w,  w = q w_lower + (1 - q) w_upper,  q = 1/2, with the
normalised firing of the lower and of the upper sets. With an uncertainty of 0 the network is of type 1.

The feedback e(t) is caused by the error of the output one loop delay earlier. Therefore each rule has a trace, which is
its weight w after a lag of about this delay. The consequents are updated with the traces:

    trace' = (w - trace) / lag,   f' = eta e trace / (trace . trace)

The lagged output f . trace then changes at the rate eta e for any number of firing rules. Each f is bounded.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import isnan, radians, sqrt
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.control.base import Situation
from agrobot_mj.control.kinematic import Kinematic
from agrobot_mj.control.t2fnn_laws import membership, normalise
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.signals import Array, Column, Command
from agrobot_mj.core.spec import NonNegative, Positive, Spec
from agrobot_mj.extensions.learners.laws import LawInside
from agrobot_mj.extensions.learners.learning import ANGLE_COLUMNS, AngleLearner

Q = 0.5  # Weight q of the lower firing in the output [-]
LEAST_TRACE = 0.01
"""Lower limit of the squared norm of the rule traces (lagged rule weights) in the update of the consequents [-]. For N
rules with equal firing, the squared norm is 1/N."""


class PathInput(NamedTuple):
    """Inputs of the network: path curvature, path speed and ground roll."""

    curvature: float  # Curvature of the path ahead [1/m], left positive
    speed: float  # Speed of the reference [m/s]
    roll: float = 0.0  # Roll of the ground [rad], left side up positive


class PathNetworkState(NamedTuple):
    """Learned consequents of the network, and a trace (lagged weight) of each rule."""

    f: Array  # Consequents, shape (rules,), with curvature as the slowest and roll as the fastest index [rad]
    trace: Array  # Trace of each rule [-], which is its lagged weight w, shape (rules,)


class PathNetwork(Spec):
    """Network of interval type-2 fuzzy sets over curvature, speed and roll, with consequents learned from feedback."""

    eta: NonNegative = 0.2
    """Fraction of the feedback learned per second [1/s]. Assumed value (range 0.1-0.6). Larger values cause
    oscillation."""
    trace_s: Positive = 0.4
    """Time constant of the rule traces (lagged rule weights) [s], equal to the delay plus the lag of the steering
    response. Assumed value (range 0.2-0.8)."""
    uncertainty: float = Field(0.3, ge=0, lt=0.5)
    """Relative difference between the width of a fuzzy set and the distance of the set centres [-]. Assumed value
    (range 0-0.49). At 0.5 the sets have gaps."""
    curvature_sets: int = Field(11, ge=1, le=51)
    """Number of fuzzy sets for the curvature [-]. Assumed value (range 5-21), which spaces the centres by 0.1 1/m."""
    curvature_range_per_m: Positive = 0.5
    """Magnitude of the curvature at the centres of the outermost fuzzy sets [1/m]. Assumed value (range 0.3-0.7), for
    an arc of 2 m radius."""
    speed_sets: int = Field(2, ge=1, le=21)
    """Number of fuzzy sets for the speed [-], with centres from 0 upwards. Assumed value (range 1-5)."""
    speed_range_m_s: Positive = 3.0
    """Speed at the centre of the highest fuzzy set [m/s]. Assumed value (range 2-5)."""
    roll_sets: int = Field(3, ge=1, le=21)
    """Number of fuzzy sets for the roll [-]. Assumed value (range 1-7). More than one set needs
    `sensors.imu.enabled`."""
    roll_range_rad: Positive = 0.26
    """Magnitude of the roll at the centres of the outermost fuzzy sets [rad]. Assumed value (range 0.1-0.4)."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of fuzzy sets for curvature, for speed and for roll."""
        return self.curvature_sets, self.speed_sets, self.roll_sets

    def init(self) -> PathNetworkState:
        """Return the state of the network before learning, in which consequents and rule traces are zero."""
        rules = int(np.prod(self.shape))
        return PathNetworkState(np.zeros(rules), np.zeros(rules))

    def firing(self, x: PathInput) -> Array:
        """Return the normalised weight w of each rule [-], shape (rules,)."""
        lower, upper = np.ones(1), np.ones(1)
        for value, sets in zip(x, _sets(self), strict=True):
            inside = min(max(value, sets.centres[0]), sets.centres[-1])  # the outermost sets apply outside the range
            lower = np.outer(lower, membership(inside, sets.centres, sets.lower)).ravel()
            upper = np.outer(upper, membership(inside, sets.centres, sets.upper)).ravel()
        w: Array = Q * normalise(lower) + (1 - Q) * normalise(upper)
        return w

    def fade_traces(self, state: PathNetworkState, w: Array, dt: float) -> PathNetworkState:
        """Return the state `dt` [s] later, with rule traces that follow the rule weights `w` with a first-order lag."""
        return state._replace(trace=state.trace + (w - state.trace) * dt / (self.trace_s + dt))

    def learn(self, state: PathNetworkState, e: float, bound: float, dt: float) -> PathNetworkState:
        """Return the state with consequents updated by feedback `e` [rad] over `dt` [s], within +-`bound` [rad]."""
        step = dt * self.eta * e * state.trace / max(float(state.trace @ state.trace), LEAST_TRACE)
        return state._replace(f=np.clip(state.f + step, -bound, bound))


class Sets(NamedTuple):
    """Fuzzy sets of one input of the network."""

    centres: Array  # Centres of the sets [unit of the input]
    lower: Array  # Widths of the lower sets [unit of the input]
    upper: Array  # Widths of the upper sets [unit of the input]


@lru_cache(maxsize=16)
def _sets(network: PathNetwork) -> tuple[Sets, ...]:
    curvature, speed, roll = network.curvature_range_per_m, network.speed_range_m_s, network.roll_range_rad
    ranges = ((-curvature, curvature), (0.0, speed), (-roll, roll))
    return tuple(_evenly(n, *span, network.uncertainty) for n, span in zip(network.shape, ranges, strict=True))


def _evenly(n: int, low: float, high: float, uncertainty: float) -> Sets:
    """Return `n` fuzzy sets with evenly spaced centres from `low` to `high`. A single set is centred and always
    active."""
    centres = np.linspace(low, high, n) if n > 1 else np.array([(low + high) / 2])
    distance = (high - low) / max(n - 1, 1)
    return Sets(centres, np.full(n, (1 - uncertainty) * distance), np.full(n, (1 + uncertainty) * distance))


class LearnedState(NamedTuple):
    """State of the guidance law `LearnedFeedforward` between two ticks."""

    inner: Any
    network: PathNetworkState  # State of the network after the learning step of the last tick
    steer: float = 0.0  # Last commanded steering angle [rad]
    feedforward: float = 0.0  # Learned steering angle in the last tick [rad]
    feedback: float = 0.0  # Steering angle added by the feedback law [rad]
    learning: bool = False  # Whether the last tick was used for learning


class LearnedFeedforward(AngleLearner):
    """Guidance law that adds a learned steering angle, which depends on the path ahead, to any feedback law."""

    kind: Literal["learned_feedforward"] = "learned_feedforward"
    label: ClassVar = "learned feedforward"
    inner: Annotated[LawInside, Field(discriminator="kind")] = Kinematic()
    """Feedback law, selected by its own `kind`. A kinematic law uses the yaw controller of `[controller]`."""
    network: PathNetwork = PathNetwork()
    """Network that maps the path to the learned steering angle."""
    preview_s: Annotated[float, Field(ge=0, le=5)] = 0.3
    """Preview time of the path input relative to the reference [s]. Assumed value (range 0.2-0.6), as for
    `feedforward`."""
    bound_deg: Annotated[float, Field(gt=0, le=45)] = 35.0
    """Maximum magnitude of a consequent of the network [deg]. Assumed value (range 5-45): the steering angle on an arc
    of 2 m radius. Use a lower value if `inner` has a separate feedforward."""
    max_offset_m: Positive = 2.0
    """Lateral offset above which learning is suspended [m]. Assumed value (range 0.5-3): the limit of the
    supervisor."""
    max_steer_lag_deg: Positive = 6.0
    """Difference between measured and last commanded angle [deg] above which learning is suspended. Assumed value
    (range 3-10): about 2 deg are normal on an arc. Feedback is not meaningful while the valve moves to a new angle."""
    tunable: ClassVar = {"network.eta": (0.02, 1.0)}
    """Search range of the learning rate for tuning, in addition to the gains of the yaw controller."""
    tuned: ClassVar = {
        "learned_feedforward with pd": {
            "guidance.inner.scheduled_above_m_s": 1.5,
            "guidance.network.eta": 0.79,
            "controller.kp": 0.82,
            "controller.kd": 0.15,
        }
    }

    def init(self) -> LearnedState:
        """Return the initial state, before the first tick."""
        return LearnedState(self.inner.init(), self.network.init())

    def update(self, state: LearnedState, situation: Situation, dt: float) -> tuple[LearnedState, Command]:
        """Return the new state, and the command of the feedback law with the learned steering angle added."""
        w, map_ = self.network.firing(self.inputs(situation)), state.network
        ahead, answered = float(map_.f @ w), float(map_.f @ map_.trace)
        e, r = situation.estimate, situation.reference
        offset = to_heading(r.yaw, r.x - e.x, r.y - e.y)[1]
        inner, command, feedback, learning = self.correct(state, situation, ahead, answered, offset, dt)
        if learning:
            map_ = self.network.learn(map_, feedback, radians(self.bound_deg), dt)
        map_ = self.network.fade_traces(map_, w, dt)
        return LearnedState(inner, map_, command.steer, ahead, feedback, learning), command

    def inputs(self, situation: Situation) -> PathInput:
        """Return the network inputs for the path ahead. The roll is 0 without a measurement."""
        ahead = situation.route.at(situation.t + self.preview_s)
        roll = 0.0 if isnan(situation.roll) else situation.roll
        return PathInput(ahead.curvature, sqrt(ahead.vx**2 + ahead.vy**2), roll)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the inner law, of the learned angle, of the learning flag, and of the consequents of all fuzzy
        rules."""
        names = [_rule(i, self.network.shape) for i in range(len(self.network.init().f))]
        weights = [Column(f"map_{name}", "rad", f"consequent of rule {name}: curvature, speed, roll") for name in names]
        return (*self.inner.columns, *ANGLE_COLUMNS, *weights)

    def report(self, state: LearnedState) -> Sequence[float]:
        """Return the values of the log columns for a state, in the order of `columns`."""
        own = (state.feedforward, state.feedback, float(state.learning))
        return (*self.inner.report(state.inner), *own, *state.network.f.tolist())


def _rule(number: int, shape: tuple[int, int, int]) -> str:
    curvature, rest = divmod(number, shape[1] * shape[2])
    return f"{curvature}_{rest // shape[2]}_{rest % shape[2]}"
