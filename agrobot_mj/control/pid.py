"""PID controller, speed and steering loops, and brake.

Both valves accept 0-12 V and are neutral at 6 V; a higher voltage steers left and moves the pedal forward. The
structure is that of the paper, section V-B: two cascaded PIDs for the speed and an inner loop for the steering. The
gains are assumed values for the delays, lags and dead bands of `hydraulics` and `driveline`.

The brake is applied when standstill is commanded: a speed of exactly zero, a supervisor stop with neutral pedal, or a
crawl while the reference is at rest. The hydrostat slows the tractor until then. The brake cuts the power of the pedal
valve, stops the tractor and holds it until a speed is commanded. A path-following law does not steer while the brake
holds the tractor, because estimation noise would turn the wheels and thereby move the tractor by millimetres.
"""

from math import inf, isfinite, radians
from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.control.base import AngleLoop
from agrobot_mj.core.signals import NEUTRAL_V, Command, Reference
from agrobot_mj.core.spec import NonNegative, Positive, Spec


def clip(x: float, low: float, high: float) -> float:
    """Return x limited to [low, high]."""
    return min(max(x, low), high)


class FilteredRate(NamedTuple):
    """State of a filtered derivative: last value and its rate of change."""

    value: float | None = None
    """Last value; None before the first value [unit]."""
    rate: float = 0.0
    """Filtered rate of change of the value [unit/s]."""

    def after(self, value: float, dt: float, filter_s: float) -> "FilteredRate":
        """Return the state after the next value, `dt` [s] later, filtered with the time constant `filter_s` [s]."""
        if self.value is None:
            return FilteredRate(value, 0.0)
        raw = (value - self.value) / dt
        return FilteredRate(value, self.rate + (raw - self.rate) * dt / (filter_s + dt))


class PidState(NamedTuple):
    """State of a `Pid`."""

    integral: float = 0.0
    """Integral part of the output [unit of the output]."""
    slope: FilteredRate = FilteredRate()
    """Filtered derivative of the error [unit of the error per s]."""


class Pid(Spec):
    """PID controller with a filtered derivative; the units depend on the loop."""

    kp: float = 1.0
    """Proportional gain [output/error]. Assumed value, tuned."""
    ki: float = 0.0
    """Integral gain [output/(error s)]. Assumed value, tuned."""
    kd: float = 0.0
    """Derivative gain [output s/error]. Assumed value, tuned."""
    derivative_filter_s: NonNegative = 0.1
    """Time constant of the low-pass filter of the derivative [s]. Assumed value of one or two ticks."""

    def init(self) -> PidState:
        """Return the initial state."""
        return PidState()

    def update(
        self, state: PidState, error: float, dt: float, low: float, high: float, ahead: float = 0.0
    ) -> tuple[PidState, float]:
        """Return the new state and the output within [low, high] after `dt` [s]; `ahead` is the feed-forward term.

        Anti-windup: the integral is frozen if its step would move the output further beyond a limit.
        """
        slope = state.slope.after(error, dt, self.derivative_filter_s)
        direct = ahead + self.kp * error + self.kd * slope.rate
        step = self.ki * error * dt
        wanted = direct + state.integral + step
        winding = (wanted > high and step > 0) or (wanted < low and step < 0)
        integral = state.integral if winding else state.integral + step
        return PidState(integral, slope), clip(direct + integral, low, high)


def over_dead_band(error: float, jump: float, tolerance: float) -> float:
    """Return the voltage that compensates the dead band of a valve [V].

    The voltage is 0 for errors below `tolerance` and rises linearly to `jump` at twice the tolerance.
    """
    size = jump * clip(abs(error) / tolerance - 1, 0.0, 1.0)
    return size if error > 0 else -size


class SpeedState(NamedTuple):
    """State of a `SpeedLoop`."""

    outer: PidState
    inner: PidState
    reference: float = 0.0
    """Last pedal reference [-]."""


class SpeedLoop(Spec):
    """Cascaded PIDs: speed error to pedal reference to valve voltage (paper, section V-B).

    The default gains of the outer PID are inversely proportional to the full speed of the machine.
    """

    sized: ClassVar = {key: {"speed": -1} for key in ("feedforward_s_m", "outer.kp", "outer.ki")}

    outer: Pid = Pid(kp=0.05, ki=0.1)
    """Outer PID: speed error [m/s] to pedal reference [-]. Assumed value."""
    inner: Pid = Pid(kp=6.0)
    """Inner PID: pedal error [-] to voltage [V]. Assumed value."""
    feedforward_s_m: NonNegative = 0.2
    """Feed-forward pedal divided by the speed reference [s/m]; 0.2 is full pedal at 5 m/s. Assumed value: without
    feed-forward, the required PID gains cause speed oscillation on compliant tyres."""
    deadband_compensation_v: NonNegative = 0.25
    """Voltage that compensates the valve's dead band [V]. Assumed value, below the dead band to avoid limit cycles."""
    tolerance: Positive = 0.005
    """Maximum pedal error without dead-band compensation [-]. Assumed value, below the noise of the potentiometer."""

    def init(self) -> SpeedState:
        """Return the initial state."""
        return SpeedState(self.outer.init(), self.inner.init())

    def update(
        self, state: SpeedState, speed_ref: float, speed: float, pedal: float, dt: float
    ) -> tuple[SpeedState, tuple[float, float]]:
        """Return the state, pedal reference (-1 to 1) and pedal valve voltage [V] for speeds [m/s] and pedal [-]."""
        ahead = self.feedforward_s_m * speed_ref
        outer, pedal_ref = self.outer.update(state.outer, speed_ref - speed, dt, -1.0, 1.0, ahead)
        return self.hold(SpeedState(outer, state.inner), pedal_ref, pedal, dt)

    def hold(
        self, state: SpeedState, pedal_ref: float, pedal: float, dt: float
    ) -> tuple[SpeedState, tuple[float, float]]:
        """Return the new state and the pedal valve voltage [V] of the inner loop for a given pedal reference [-]."""
        error = pedal_ref - pedal
        jump = over_dead_band(error, self.deadband_compensation_v, self.tolerance)
        inner, voltage = self.inner.update(state.inner, error, dt, -NEUTRAL_V, NEUTRAL_V, jump)
        return SpeedState(state.outer, inner, pedal_ref), (pedal_ref, NEUTRAL_V + voltage)


class SteeringState(NamedTuple):
    """State of a `SteeringLoop`."""

    pid: PidState
    reference: float = 0.0
    """Last reference angle, limited in rate [rad]."""


class SteeringLoop(AngleLoop):
    """PID steering loop: steering angle error to valve voltage."""

    kind: Literal["pid"] = "pid"
    pid: Pid = Pid(kp=20.0, ki=3.0, kd=2.0, derivative_filter_s=0.05)
    """PID from angle error [rad] to voltage [V]. Assumed value."""
    deadband_compensation_v: NonNegative = 0.3
    """Voltage that compensates the valve's dead band [V]. Assumed value, below the dead band to avoid limit cycles."""
    tolerance_deg: Positive = 0.1
    """Maximum angle error without dead-band compensation [deg]. Assumed value, below the potentiometer's 1 deg."""
    reference_rate_deg_s: Positive | None = None
    """Maximum rate of the reference angle [deg/s]. Default: null (no limit), as in the paper. A limit of 26 deg/s, the
    maximum rate with the valve, removes the jump of the command when GNSS returns."""

    def init(self) -> SteeringState:
        """Return the initial state, with the wheels straight ahead."""
        return SteeringState(self.pid.init())

    def update(self, state: SteeringState, wanted: float, steer: float, dt: float) -> tuple[SteeringState, float]:
        """Return the new state and the steering valve voltage [V] for the commanded and measured angles [rad]."""
        steer_ref = self._reference(state.reference, wanted, dt)
        error = steer_ref - steer
        jump = over_dead_band(error, self.deadband_compensation_v, radians(self.tolerance_deg))
        pid, voltage = self.pid.update(state.pid, error, dt, -NEUTRAL_V, NEUTRAL_V, jump)
        return SteeringState(pid, steer_ref), NEUTRAL_V + voltage

    def _reference(self, last: float, wanted: float, dt: float) -> float:
        """Return the reference angle [rad], moved from `last` towards `wanted` at the limited rate for `dt` [s]."""
        if self.reference_rate_deg_s is None:
            return wanted
        reach = radians(self.reference_rate_deg_s) * dt
        return clip(wanted, last - reach, last + reach)


STANDSTILL_S = 1.0
"""Duration of commanded standstill before the brake is applied [s]. Assumed value, three time constants of the pump."""
STOPPED_S = 2.0
"""Time that the brake needs to stop the tractor [s]. Assumed value, twice the braking time from field speed."""
CRAWL_M_S = 0.1
"""Maximum commanded speed of a standstill while the reference is at rest [m/s]. Assumed value for GNSS noise."""


class BrakeState(NamedTuple):
    """State of the brake; the tractor is parked before the first tick."""

    standing_s: float = inf
    """Time for which standstill has been commanded [s]."""

    @property
    def share(self) -> float:
        """Applied fraction of the brake torque, 0 or 1 [-]."""
        return 1.0 if self.standing_s >= STANDSTILL_S else 0.0

    @property
    def stands(self) -> bool:
        """Whether the tractor has been stopped by the brake and is held."""
        return self.standing_s >= STANDSTILL_S + STOPPED_S

    def after(self, command: Command, reference: Reference, dt: float) -> "BrakeState":
        """Return the brake state `dt` [s] later, for the command to the low-level loops and the path reference."""
        asked = command.speed if command.pedal is None else command.pedal
        if asked == 0.0:
            return BrakeState(self.standing_s + dt)
        crawls = command.pedal is None and abs(asked) < CRAWL_M_S and reference.vx == reference.vy == 0.0
        # a path may begin at rest: count only time within the run
        return BrakeState((self.standing_s if isfinite(self.standing_s) else 0.0) + dt if crawls else 0.0)
