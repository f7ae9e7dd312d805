"""What guidance laws and yaw controllers share: the contract of both families.

A guidance law sees a `Situation` - the estimate, the path, the machine's known numbers, never the truth - and answers
with a `Command`: steering angle and speed. The paper's law (`kinematic`) hands a yaw-rate reference to a yaw controller
of its own family, `[controller]`; other laws need none. Both keep their state outside: `init() -> State` and
`update(state, ...) -> (State, output)`. Further signals go into the log as `columns`, with values from `report`.
"""

from collections.abc import Mapping, Sequence
from math import atan, nan
from typing import Any, ClassVar, NamedTuple, Protocol

from agrobot_mj.core.learned import Learned
from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Array, Column, Command, Estimate, PathPoint, Reference
from agrobot_mj.machine.implements import TowedImplement
from agrobot_mj.machine.tractor import TractorParameters

SLOWEST_M_S = 0.3
"""Speed below which the lateral acceleration and gains are those of this speed [m/s]."""


class Route(Protocol):
    """A path that can be asked for its nearest point and for what lies ahead, at any time of a run."""

    def at(self, t: float) -> Reference:
        """The reference at time `t` [s]."""
        ...

    def nearest(self, x: float, y: float, near: float, t: float) -> PathPoint:
        """The path's nearest point to (x, y) [m], sought along the path about the distance `near` [m].

        On the leg, between two reversals of direction, on which the reference is at time `t` [s].
        """
        ...

    def ahead(self, s: float) -> PathPoint:
        """The path at the distance `s` [m] from its start, `offset` 0; straight on beyond its ends."""
        ...

    def curvatures(self, ways: Sequence[float]) -> Array:
        """Curvatures of the path at the distances `ways` [m] from its start, as `ahead` has them, shape (n,) [1/m]."""
        ...

    def leg(self, t: float) -> tuple[float, float]:
        """Distances [m] between which the reference keeps its direction of travel at time `t` [s]."""
        ...

    def passed(self, t: float) -> float:
        """Distance that the reference has passed at time `t` [s], to some centimetres [m]."""
        ...

    def lap(self) -> float:
        """Distance after which the path's heading comes again, its whole length where it does not [m]."""
        ...


class Situation(NamedTuple):
    """Everything that a guidance law may know in one tick."""

    t: float
    """Time since the start [s]."""
    estimate: Estimate
    """Pose of the CG, speed, yaw rate and covariance."""
    reference: Reference
    """The path's reference at `t`."""
    route: Route
    """The path: nearest points, curvature ahead."""
    machine: TractorParameters
    """Geometry and limits of the machine."""
    steer: float
    """Measured steering angle, left positive [rad]."""
    roll: float = nan
    """Measured roll, left side up positive; NaN without an inertial unit [rad]."""
    implement: tuple[float, float] = (nan, nan)
    """Measured place where the implement works, east and north; NaN without a receiver on it [m]."""
    towed: TowedImplement = TowedImplement()
    """Implement behind the tractor."""

    def steer_limit(self, lateral_acceleration_m_s2: float) -> float:
        """Largest steering angle either way at which the turn stays below this lateral acceleration [rad]."""
        m, u = self.machine, max(abs(self.estimate.speed), SLOWEST_M_S)
        return min(m.steer_limit, atan(m.wheelbase_m * lateral_acceleration_m_s2 / u**2))


class Learner(Reporting):
    """Base of the parts that may learn, and whose knowledge outlasts a run."""

    def check(self) -> None:
        """Read what the part takes from files. Raises ValueError, naming the key."""

    def learned(self, state: Any) -> Learned:
        """What it has learnt, see `core.learned`; nothing for a part that does not learn."""
        return {}


class GuidanceLaw(Learner):
    """Base of every guidance law, `[guidance] kind`."""

    kind: str
    tunable: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Keys that a tuning may change, with their ranges in the keys' units; none by default."""
    tuned: ClassVar[Mapping[str, Mapping[str, float]]] = {}
    """Gains beside those of `control.gains`, of the same form."""
    holds_lane_change: ClassVar[bool] = False
    """Whether the law claims a cross-track rms below 0.25 m on a lane change, and stable turns on a worn valve."""

    @property
    def needs(self) -> dict[str, str]:
        """Sensors that the scenario must enable, each with the key that asks for it, as messages name it."""
        return {}

    def init(self) -> Any:
        """State before the first tick."""
        return None

    def update(self, state: Any, situation: Situation, dt: float) -> tuple[Any, Command]:
        """State and command after a tick of `dt` [s]."""
        raise NotImplementedError

    def feedback(self, state: Any, command: Command) -> float:
        """Part of the last command's steering angle that corrects errors; the rest is feed-forward [rad]."""
        return command.steer

    @property
    def follows_path(self) -> bool:
        """Whether the law follows the path at all; the supervisor monitors only those that do."""
        return True

    @property
    def outside(self) -> str:
        """Command of the command line that runs a law which lives outside; empty for the others."""
        return ""

    def using(self, controller: "YawController") -> "GuidanceLaw":
        """The law with the yaw controller of the scenario inside; itself where it needs none."""
        return self


class LawAround(GuidanceLaw):
    """Base of the laws that have another law inside."""

    inner: GuidanceLaw
    """The law inside."""

    def using(self, controller: "YawController") -> GuidanceLaw:
        """With the yaw controller inside the inner law, where that takes one."""
        inner = self.inner.using(controller)
        return self if inner is self.inner else self.model_copy(update={"inner": inner})

    @property
    def follows_path(self) -> bool:
        """As the law inside."""
        return self.inner.follows_path


YAW_COLUMNS = (
    Column("yaw_rate_ref", "rad/s", "yaw-rate reference of the guidance law, left positive"),
    Column("e_yaw_rate", "rad/s", "yaw-rate reference less estimated yaw rate"),
    Column("tau_c", "rad", "output of the conventional (PD) controller"),
    Column("tau_n", "rad", "output of the network, or of the integral that stands in for it; steer = tau_c - tau_n"),
    Column("q", "-", "share of the lower firing level in the network's output; null without a network"),
)
"""Signals of the paper's cascade that every log has a place for."""


class YawCommand(NamedTuple):
    """Command of a yaw controller to the steering, and its parts."""

    steer: float
    """Front-wheel angle, left positive, clipped at the steering limit [rad]."""
    tau_c: float = 0.0
    """Output of the conventional (PD) controller [rad]."""
    tau_n: float = 0.0
    """Output of the network or of its stand-in; steer = tau_c - tau_n within limits [rad]."""
    q: float = nan
    """Share of the lower firing level in the network's output; NaN without a network [-]."""


class YawController(Reporting):
    """Base of every yaw controller, `[controller] kind`: yaw-rate error to steering angle."""

    kind: str
    closed_loop: ClassVar[bool] = True
    """Whether the law uses the yaw rate."""
    tunable: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Keys that a tuning may change, with their ranges in the keys' units."""

    def init(self) -> Any:
        """State before the first tick."""
        raise NotImplementedError

    def update(
        self, state: Any, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[Any, YawCommand]:
        """State and command at time `t` [s] from the error [rad/s] after `dt` [s]; `steer_limit` [rad]."""
        raise NotImplementedError

    def relieve(self, state: Any, excess: float) -> Any:
        """State after the whole command, feed-forward included, was `excess` [rad] beyond the limit or the wheels.

        For anti-windup; a controller without an integral that could wind up has nothing to do.
        """
        return state


class AngleLoop(Learner):
    """Base of every steering loop, `[steering.loop] kind`: steering angle to valve voltage. Its state has `reference`,
    the present reference angle [rad]."""

    kind: str

    def init(self) -> Any:
        """State at rest, straight ahead."""
        raise NotImplementedError

    def update(self, state: Any, wanted: float, steer: float, dt: float) -> tuple[Any, float]:
        """State and valve voltage [V] from the commanded and the measured angle [rad] after `dt` [s]."""
        raise NotImplementedError
