"""Interfaces of the guidance laws, yaw controllers and steering loops.

A guidance law receives a `Situation` (state estimate, path, known machine parameters; never the true state) and returns
a `Command` of steering angle and speed. The laws `kinematic` (from the paper) and `feedforward` pass a yaw-rate
reference to the yaw controller configured in `[controller]`; other laws need no yaw controller. State is passed
explicitly: `init() -> State` and `update(state, ...) -> (State, output)`. `columns` declares additional log columns;
`report` returns the values of these columns.
"""

from collections.abc import Mapping, Sequence
from math import atan, nan, radians
from typing import Any, ClassVar, NamedTuple, Protocol

from agrobot_mj.core.calls import Linked
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, shared
from agrobot_mj.core.learned import Learned
from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Column, Command, Estimate, PathPoint, Reference, Vector
from agrobot_mj.machine.implements import TowedImplement
from agrobot_mj.machine.tractor import TractorParameters

SLOWEST_M_S = 0.3  # Minimum speed used to compute lateral accelerations and speed-dependent gains [m/s]


@shared
def steer_limit_at(speed: float, lateral_acceleration: float, wheelbase: float, steer_limit: float) -> float:
    """Return the maximum absolute steering angle [rad] at which the lateral acceleration [m/s2] is within its limit.

    `steer_limit` [rad] is the maximum angle of the wheels. Speeds below SLOWEST_M_S count as SLOWEST_M_S.
    """
    u = max(abs(speed), SLOWEST_M_S)
    return min(steer_limit, atan(wheelbase * lateral_acceleration / (u * u)))


class Route(Protocol):
    """Interface of the path of a run, with queries for the nearest point and for points ahead."""

    def at(self, t: float) -> Reference:
        """Return the reference (position, velocity, heading and curvature) at time `t` [s]."""
        ...

    def nearest(self, x: float, y: float, near: float, t: float) -> PathPoint:
        """Return the path point nearest to (x, y) [m], within a search range around the arc length `near` [m].

        The search is limited to the leg (the segment between two reversals) on which the reference is at time `t` [s].
        """
        ...

    def ahead(self, s: float) -> PathPoint:
        """Return the path point at arc length `s` [m] with `offset` 0; the path continues straight beyond its ends."""
        ...

    def curvatures(self, distances: Sequence[float] | Vector) -> Vector:
        """Return the path curvatures [1/m] at the arc lengths `distances` [m], shape (n,), extended as in `ahead`."""
        ...

    def leg(self, t: float) -> tuple[float, float]:
        """Return the start and end arc lengths [m] of the leg (path between two reversals) that the reference travels
        at time `t` [s]."""
        ...

    def distance_at(self, t: float) -> float:
        """Return the arc length [m] of the reference at time `t` [s], accurate to a few centimetres."""
        ...

    def lap(self) -> float:
        """Return the arc length [m] after which the path heading repeats, or the path length if it never repeats."""
        ...


class Situation(NamedTuple):
    """Inputs of a guidance law in one tick."""

    t: float  # Time since the start of the run [s]
    estimate: Held[Estimate]  # Estimated pose of the CG, speed, yaw rate and covariance
    reference: Reference  # Reference on the path at time `t`
    route: Route  # Path of the run
    machine: TractorParameters  # Parameters of the tractor
    steer: float  # Measured steering angle [rad], left positive
    roll: float = nan  # Measured roll angle [rad], positive with the left side up, or NaN if there is no inertial unit
    implement: tuple[float, float] = (nan, nan)
    """Measured east and north position of the implement's working point [m], or NaN if not measured."""
    towed: TowedImplement = TowedImplement()  # Dimensions and state of the implement

    def fetched(self) -> "Situation":
        """Return a copy of the situation whose estimate is a named tuple with a read-only covariance."""
        estimate = fetched(self.estimate)
        if estimate is self.estimate:
            return self
        estimate.covariance.flags.writeable = False
        return Situation(self.t, estimate, *self[2:])  # faster than `_replace`

    def steer_limit(self, lateral_acceleration_m_s2: float) -> float:
        """Return the maximum absolute steering angle [rad] that respects a lateral-acceleration limit [m/s2]."""
        m = self.machine
        return steer_limit_at(self.estimate.speed, lateral_acceleration_m_s2, m.wheelbase_m, m.steer_limit)


class Learner(Reporting):
    """Base class of the components whose learned values can be saved for the next run."""

    def check(self) -> None:
        """Read the files named by the component's keys. Raise a ValueError that names the key of an invalid file."""

    def learned(self, state: Any) -> Learned:
        """Return the learned quantities (see `core.learned`), or an empty mapping if the component does not learn."""
        return {}


class GuidanceLaw(Learner):
    """Base class of the guidance laws, selected by `[guidance] kind`."""

    kind: str
    tunable: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Search range (minimum, maximum) of each tunable key, in the unit of the key. Default: none."""
    tuned: ClassVar[Mapping[str, Mapping[str, float]]] = {}
    """Tuned gains by law name and dotted scenario key, in addition to the gains in `control.gains.TUNED`."""
    timed: ClassVar[bool] = True
    """Whether a run with this law ends as `diverged` if the tractor is far from the moving reference point."""
    holds_lane_change: ClassVar[bool] = False
    """Whether tests require the law to follow a lane change (cross-track RMS below 0.25 m), also with a worn valve."""

    @property
    def needs(self) -> dict[str, str]:
        """Required sensors, each mapped to the scenario key that requires the sensor. Default: none."""
        return {}

    def init(self) -> Any:
        """Return the initial state of the law."""
        return None

    def update(self, state: Any, situation: Situation, dt: float) -> tuple[Any, Command]:
        """Return the new state of the law and the command for a tick of `dt` [s]."""
        raise NotImplementedError

    @property
    def interpreted(self) -> bool:
        """Whether ticks in compiled code must call the Python method `update`. Default: True."""
        return True

    def compiled_tick(self, state: Any, machine: TractorParameters) -> Linked | None:
        """Return the compiled tick function, its parameters and its state, or None if the next tick needs Python."""
        return None

    def state_after_ticks(self, state: Any, found: Held[Any], followed: Any, shown: Vector) -> Any:
        """Return the state of the law after ticks in compiled code.

        `found` is the last state in compiled code, and `followed` the last command with the path errors. `shown`
        contains the last values of the log columns.
        """
        return found

    def feedback(self, state: Any, command: Command) -> float:
        """Return the feedback part of the last steering command [rad], without feed-forward."""
        return command.steer

    @property
    def follows_path(self) -> bool:
        """Whether the law follows the path. The supervisor monitors only laws that follow the path."""
        return True

    @property
    def outside(self) -> str:
        """Subcommand of `agrobot-mj` that connects the external program of the law, or an empty string for other
        laws."""
        return ""

    def using(self, controller: "YawController") -> "GuidanceLaw":
        """Return the law combined with the scenario's yaw controller, or the law itself if no controller is needed."""
        return self


YAW_COLUMNS = (
    Column("yaw_rate_ref", "rad/s", "yaw-rate reference of the guidance law, left positive"),
    Column("e_yaw_rate", "rad/s", "yaw-rate reference minus estimated yaw rate"),
    Column("tau_c", "rad", "output of the conventional (PD) controller"),
    Column("tau_n", "rad", "output of the network, or of the integral that replaces it; steer = tau_c - tau_n"),
    Column("q", "-", "weight of the lower firing level in the network's output; null without a network"),
)
"""Log columns of the cascade of guidance law and yaw controller, present in every log."""


class YawCommand(NamedTuple):
    """Steering command of a yaw controller, with the components of the command."""

    steer: float  # Front-wheel angle [rad], positive left, limited to the maximum steering angle
    tau_c: float = 0.0  # Output of the conventional (PD) controller [rad]
    tau_n: float = 0.0
    """Output of the network or integral term [rad]. `steer` is tau_c - tau_n, limited to the maximum steering angle."""
    q: float = nan
    """Weight of the lower firing strengths in the output of a type-2 fuzzy network [-], or NaN without a network."""


WHEEL_LAG = radians(5.0)
"""Steering-angle lag (command minus measurement) above which the integral of the yaw controller stops growing [rad].
Assumed value.
"""


@shared
def excess_of(command: YawCommand, ahead: float, steer: float, measured: float) -> float:
    """Return the argument `excess` of `YawController.relieve` [rad], or 0 if no anti-windup is needed.

    `ahead` is the feed-forward angle, `steer` the limited total command, and `measured` the measured angle [rad].
    """
    beyond, lag = command.tau_c - command.tau_n + ahead - steer, steer - measured
    if beyond != 0.0:
        return beyond
    return lag if abs(lag) > WHEEL_LAG else 0.0


def controller_form(
    law: Held[Any], state: Held[Any], e: float, ahead: float, steer: float, dt: float, limit: float
) -> tuple[Held[Any], YawCommand, Vector]:
    """Define the signature of a compiled yaw controller with anti-windup. The function itself is never called.

    The arguments are parameters, state, yaw-rate error [rad/s], feed-forward angle and measured steering angle [rad],
    length of the tick [s] and maximum steering angle [rad]. The results are the new state, the command, and the values
    of the log columns.
    """
    raise NotImplementedError


class YawController(Reporting):
    """Base class of yaw controllers (`[controller] kind`), which map the yaw-rate error to a steering angle."""

    kind: str
    closed_loop: ClassVar[bool] = True
    """Whether the controller uses the measured yaw rate."""
    tunable: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Search range (minimum, maximum) of each tunable key, in the unit of the key. Default: none."""

    def init(self) -> Any:
        """Return the initial state of the controller."""
        raise NotImplementedError

    def update(
        self, state: Any, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[Any, YawCommand]:
        """Return the new state and the steering command at time `t` [s] for a tick of `dt` [s].

        `yaw_rate_error` [rad/s] is the controller input; `steer_limit` [rad] is the maximum absolute steering angle.
        """
        raise NotImplementedError

    @property
    def interpreted(self) -> bool:
        """Whether ticks in compiled code must call the Python methods `update` and `relieve`.

        Default: true unless the class itself defines `compiled_tick`, so that a subclass may override any method.
        """
        return "compiled_tick" not in vars(type(self))

    def compiled_tick(self, state: Any) -> Linked | None:
        """Return the compiled tick function, its parameters and its state, or None if the next tick needs Python."""
        return None

    def state_after_ticks(self, state: Any, found: Held[Any], shown: Vector) -> Any:
        """Return the state after ticks in compiled code: `found` is their last state, `shown` their last log values."""
        return fetched(found)

    def relieve(self, state: Any, excess: float) -> Any:
        """Return the state after anti-windup, which limits the integral. The default returns `state` unchanged.

        `excess` [rad] is the total steering command, including feed-forward, minus the steering limit. If the command
        is within the limit and the wheels lag behind it, `excess` is the command minus the measured angle.
        """
        return state


class AngleLoop(Learner):
    """Base class of the steering loops (`[steering.loop] kind`).

    A loop maps the commanded and measured steering angles to a valve voltage. The state has the attribute `reference`,
    the current reference angle [rad].
    """

    kind: str

    def init(self) -> Any:
        """Return the initial state, with the wheels straight ahead."""
        raise NotImplementedError

    def update(self, state: Any, wanted: float, steer: float, dt: float) -> tuple[Any, float]:
        """Return the new state and the valve voltage [V] for the commanded and measured steering angles [rad].

        `dt` [s] is the length of the tick.
        """
        raise NotImplementedError
