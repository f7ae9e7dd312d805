"""PID controller, speed and steering loops, and brake.

Steering and pedal valves accept 0-12 V and are neutral at 6 V; higher voltages steer left or move the pedal forward.
The structure is from the paper, section V-B: two cascaded PIDs for the speed and an inner loop for the steering. The
gains are assumed values for the delays, lags and dead bands of `hydraulics` and `driveline`.

The brake is applied when standstill is commanded: a speed of exactly zero, a supervisor stop with neutral pedal, or a
crawl while the reference is at rest. The hydrostat slows the tractor before the brake is applied. The brake cuts the
power of the pedal valve, stops the tractor and holds it until a speed is commanded. A path-following law does not steer
while the brake holds the tractor: estimation noise would turn the wheels and thereby move the tractor by millimetres.
"""

from math import inf, isfinite, isinf, isnan, nan, radians
from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.control.base import AngleLoop
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, jit, shared
from agrobot_mj.core.signals import NEUTRAL_V, Command, Estimate, Reference
from agrobot_mj.core.spec import NonNegative, Positive, Spec


@shared
def clip(x: float, low: float, high: float) -> float:
    """Return x limited to [low, high]."""
    return min(max(x, low), high)


class FilteredRate(NamedTuple):
    """State of a filtered derivative: last value and filtered rate of change."""

    value: float = nan  # Last value of the signal [unit of the signal], or NaN before the first value
    rate: float = 0.0  # Filtered rate of change of the signal [unit of the signal per s]

    def after(self, value: float, dt: float, filter_s: float) -> "FilteredRate":
        """Return the state after a new value, `dt` [s] later, filtered with the time constant `filter_s` [s]."""
        return slope_after(self, value, dt, filter_s)


@shared
def slope_after(s: FilteredRate, value: float, dt: float, filter_s: float) -> FilteredRate:
    """Return the filtered derivative after a new value, `dt` [s] later; `filter_s` [s] is the filter time constant."""
    if isnan(s.value):
        return FilteredRate(value, 0.0)
    raw = (value - s.value) / dt
    return FilteredRate(value, s.rate + (raw - s.rate) * dt / (filter_s + dt))


class PidState(NamedTuple):
    """State of a `Pid`."""

    integral: float = 0.0  # Integral part of the output [unit of the output]
    slope: FilteredRate = FilteredRate()  # Filtered derivative of the error [unit of the error per s]


class PidLaw(NamedTuple):
    """Parameters of a `Pid` as numbers for compiled kernels, in the units of `Pid`."""

    kp: float
    ki: float
    kd: float
    filter_s: float


@shared
def pid_step(
    p: PidLaw, s: PidState, error: float, dt: float, low: float, high: float, ahead: float
) -> tuple[PidState, float]:
    """Return the new state and the output within [low, high] after `dt` [s]; `ahead` is the feed-forward term.

    Anti-windup: the integral is frozen if its change would move the output further beyond a limit.
    """
    slope = slope_after(s.slope, error, dt, p.filter_s)
    direct = ahead + p.kp * error + p.kd * slope.rate
    step = p.ki * error * dt
    wanted = direct + s.integral + step
    winding = (wanted > high and step > 0) or (wanted < low and step < 0)
    integral = s.integral if winding else s.integral + step
    return PidState(integral, slope), clip(direct + integral, low, high)


class Pid(Spec):
    """PID controller with a filtered derivative; the units of the gains depend on the loop."""

    kp: float = 1.0
    """Proportional gain [output/error]. Assumed value from tuning."""
    ki: float = 0.0
    """Integral gain [output/(error s)]. Assumed value from tuning."""
    kd: float = 0.0
    """Derivative gain [output s/error]. Assumed value from tuning."""
    derivative_filter_s: NonNegative = 0.1
    """Time constant of the low-pass filter of the derivative [s]. Assumed value of one or two ticks."""

    def init(self) -> PidState:
        """Return the initial state, with an integral of zero."""
        return PidState()

    def update(
        self, state: PidState, error: float, dt: float, low: float, high: float, ahead: float = 0.0
    ) -> tuple[PidState, float]:
        """Return the new state and the output within [low, high] after `dt` [s]; see `pid_step`."""
        return pid_step(self.parameters(), state, error, dt, low, high, ahead)

    def parameters(self) -> PidLaw:
        """Return the gains as numbers for `pid_step`."""
        return PidLaw(self.kp, self.ki, self.kd, self.derivative_filter_s)


@shared
def over_dead_band(error: float, jump: float, tolerance: float) -> float:
    """Return the voltage [V] that compensates the dead band of a valve, with the sign of `error`.

    The voltage is 0 for errors below `tolerance` and rises linearly to `jump` [V] at twice the tolerance.
    """
    size = jump * clip(abs(error) / tolerance - 1, 0.0, 1.0)
    return size if error > 0 else -size


class SpeedState(NamedTuple):
    """State of a `SpeedLoop` between two ticks."""

    outer: PidState
    inner: PidState
    reference: float = 0.0  # Last pedal reference [-]


class SpeedLoopLaw(NamedTuple):
    """Parameters of a `SpeedLoop` as numbers for compiled kernels."""

    outer: PidLaw
    inner: PidLaw
    feedforward: float  # Feed-forward pedal divided by the speed reference [s/m]
    jump: float  # Voltage that compensates the valve's dead band [V]
    tolerance: float  # Maximum pedal error without dead-band compensation [-]


@shared
def speed_step(
    p: SpeedLoopLaw, s: SpeedState, speed_ref: float, speed: float, pedal: float, dt: float
) -> tuple[SpeedState, float]:
    """Return the new state and the voltage of the pedal valve [V].

    The inputs are the commanded and the estimated speed [m/s], and the measured pedal position [-].
    """
    outer, pedal_ref = pid_step(p.outer, s.outer, speed_ref - speed, dt, -1.0, 1.0, p.feedforward * speed_ref)
    return pedal_step(p, SpeedState(outer, s.inner, s.reference), pedal_ref, pedal, dt)


@shared
def pedal_step(p: SpeedLoopLaw, s: SpeedState, pedal_ref: float, pedal: float, dt: float) -> tuple[SpeedState, float]:
    """Return the new state and the voltage of the pedal valve [V] for the commanded and measured pedal position [-]."""
    error = pedal_ref - pedal
    jump = over_dead_band(error, p.jump, p.tolerance)
    inner, voltage = pid_step(p.inner, s.inner, error, dt, -NEUTRAL_V, NEUTRAL_V, jump)
    return SpeedState(s.outer, inner, pedal_ref), NEUTRAL_V + voltage


class SpeedLoop(Spec):
    """Speed loop of two PIDs: speed error to pedal reference, and pedal error to valve voltage (paper, section V-B).

    The default gains of the outer PID are inversely proportional to the full speed of the machine.
    """

    sized: ClassVar = {key: {"speed": -1} for key in ("feedforward_s_m", "outer.kp", "outer.ki")}

    outer: Pid = Pid(kp=0.05, ki=0.1)
    """Gains of the outer PID controller from speed error [m/s] to pedal reference [-]. Assumed values."""
    inner: Pid = Pid(kp=6.0)
    """Gains of the inner PID controller from pedal error [-] to voltage relative to neutral [V]. Assumed values."""
    feedforward_s_m: NonNegative = 0.2
    """Feed-forward pedal position divided by the speed reference [s/m]; 0.2 is full pedal at 5 m/s. Assumed value:
    without feed-forward, the required PID gains cause speed oscillation on compliant tyres."""
    deadband_compensation_v: NonNegative = 0.25
    """Voltage that compensates the valve's dead band [V]. Assumed value, below the dead band to avoid limit cycles."""
    tolerance: Positive = 0.005
    """Maximum pedal error without dead-band compensation [-]. Assumed value, below the noise of the potentiometer."""

    def init(self) -> SpeedState:
        """Return the initial state of both PIDs."""
        return SpeedState(self.outer.init(), self.inner.init())

    def parameters(self) -> SpeedLoopLaw:
        """Return the parameters of the loop as numbers for `speed_step`."""
        band = self.deadband_compensation_v, self.tolerance
        return SpeedLoopLaw(self.outer.parameters(), self.inner.parameters(), self.feedforward_s_m, *band)


class SteeringState(NamedTuple):
    """State of a `SteeringLoop` between two ticks."""

    pid: PidState
    reference: float = 0.0  # Last reference angle, limited in rate [rad]


class SteeringLoopLaw(NamedTuple):
    """Parameters of a `SteeringLoop` as numbers for compiled kernels."""

    pid: PidLaw
    jump: float  # Voltage that compensates the valve's dead band [V]
    tolerance: float  # Maximum angle error without dead-band compensation [rad]
    rate: float  # Maximum rate of the reference angle [rad/s], or infinity if there is no limit


@shared
def steering_step(
    p: SteeringLoopLaw, s: SteeringState, wanted: float, steer: float, dt: float
) -> tuple[SteeringState, float]:
    """Return the new state and the steering valve voltage [V] for the commanded and measured angles [rad].

    The reference angle moves towards the commanded angle at the limited rate.
    """
    reach = p.rate * dt
    steer_ref = wanted if isinf(p.rate) else clip(wanted, s.reference - reach, s.reference + reach)
    error = steer_ref - steer
    jump = over_dead_band(error, p.jump, p.tolerance)
    pid, voltage = pid_step(p.pid, s.pid, error, dt, -NEUTRAL_V, NEUTRAL_V, jump)
    return SteeringState(pid, steer_ref), NEUTRAL_V + voltage


class SteeringLoop(AngleLoop):
    """PID steering loop, which maps the error of the steering angle to the valve voltage."""

    kind: Literal["pid"] = "pid"
    pid: Pid = Pid(kp=20.0, ki=3.0, kd=2.0, derivative_filter_s=0.05)
    """Gains of the PID controller from angle error [rad] to valve voltage relative to neutral [V]. Assumed values."""
    deadband_compensation_v: NonNegative = 0.3
    """Voltage that compensates the valve's dead band [V]. Assumed value, below the dead band to avoid limit cycles."""
    tolerance_deg: Positive = 0.1
    """Maximum angle error without dead-band compensation [deg]. Assumed value, below the potentiometer's resolution of
    1 deg."""
    reference_rate_deg_s: Positive | None = None
    """Maximum rate of the reference angle [deg/s]. Default: null (no limit), as in the paper. A limit of 26 deg/s, the
    maximum rate of the valve, removes the jump of the command when GNSS fixes return."""

    def init(self) -> SteeringState:
        """Return the initial state, with the wheels straight ahead."""
        return SteeringState(self.pid.init())

    def update(self, state: SteeringState, wanted: float, steer: float, dt: float) -> tuple[SteeringState, float]:
        """Return the new state and the steering valve voltage [V] for the commanded and measured angles [rad]."""
        return steering_step(self.parameters(), state, wanted, steer, dt)

    def parameters(self) -> SteeringLoopLaw:
        """Return the parameters of the loop as numbers for `steering_step`."""
        rate = self.reference_rate_deg_s
        band = self.deadband_compensation_v, radians(self.tolerance_deg)
        return SteeringLoopLaw(self.pid.parameters(), *band, inf if rate is None else radians(rate))


STANDSTILL_S = 1.0
"""Duration of commanded standstill before the brake is applied [s]. Assumed value: three time constants of the pump."""
STOPPED_S = 2.0
"""Time from brake application to standstill [s]. Assumed value: twice the braking time from field speed."""
CRAWL_M_S = 0.1
"""Speed command [m/s] below which the brake is applied if the reference is at rest. Assumed value, above GNSS noise."""


class BrakeState(NamedTuple):
    """State of the brake. Before the first tick the tractor is parked."""

    standing_s: float = inf  # Time for which standstill has been commanded [s]

    @property
    def share(self) -> float:
        """Applied fraction of the brake torque, 0 or 1 [-]."""
        return 1.0 if self.standing_s >= STANDSTILL_S else 0.0

    @property
    def stands(self) -> bool:
        """Whether the brake has stopped the tractor and holds it."""
        return self.standing_s >= STANDSTILL_S + STOPPED_S

    def after(self, command: Command, reference: Reference, dt: float) -> "BrakeState":
        """Return the brake state `dt` [s] later, for a command to the low-level loops and the reference on the path."""
        return brake_after(self, loop_command_of(command, reference.vx == reference.vy == 0.0), dt)


class LoopCommand(NamedTuple):
    """Command to the low-level loops: steering angle [rad], speed [m/s], steering voltage [V], and pedal position [-].

    A missing voltage or pedal position is NaN.
    """

    steer: float
    speed: float
    steer_voltage: float
    pedal: float
    waits: bool  # Whether the reference point on the path is at rest


def loop_command_of(command: Command, waits: bool) -> LoopCommand:
    """Return a command as numbers for compiled kernels; `waits` is whether the reference on the path is at rest."""
    steer, speed, steer_voltage, pedal, _ = command
    return LoopCommand(
        steer, speed, nan if steer_voltage is None else steer_voltage, nan if pedal is None else pedal, waits
    )


@shared
def brake_after(s: BrakeState, w: LoopCommand, dt: float) -> BrakeState:
    """Return the brake state `dt` [s] later, for a command to the low-level loops."""
    asked = w.speed if isnan(w.pedal) else w.pedal
    if asked == 0.0:
        return BrakeState(s.standing_s + dt)
    if not (isnan(w.pedal) and abs(asked) < CRAWL_M_S and w.waits):
        return BrakeState(0.0)
    # a path may begin at rest: count only time within the run
    return BrakeState((s.standing_s if isfinite(s.standing_s) else 0.0) + dt)


class LoopsLaw(NamedTuple):
    """Parameters of the low-level loops as numbers for compiled kernels."""

    speed: SpeedLoopLaw
    steering: SteeringLoopLaw


class LoopsState(NamedTuple):
    """State of the low-level loops between two ticks."""

    speed: SpeedState
    steering: SteeringState
    brake: BrakeState


@jit
def loops_step(
    p: Held[LoopsLaw], s: LoopsState, w: LoopCommand, estimate: Held[Estimate], steer: float, pedal: float, dt: float
) -> tuple[LoopsState, tuple[float, float, float]]:
    """Return the new state, the steering and pedal valve voltages [V], and the applied fraction of the brake torque.

    A command may replace a loop by a steering voltage or a pedal position. `steer` [rad] and `pedal` [-] are measured.
    """
    p, brake = fetched(p), brake_after(s.brake, w, dt)
    share = 1.0 if brake.standing_s >= STANDSTILL_S else 0.0
    if share == 0.0 and isnan(w.pedal):
        driven, pedal_voltage = speed_step(p.speed, s.speed, w.speed, fetched(estimate).speed, pedal, dt)
    else:
        driven, pedal_voltage = pedal_step(p.speed, s.speed, 0.0 if share else w.pedal, pedal, dt)
    steering, steer_voltage = steering_step(p.steering, s.steering, w.steer, steer, dt)
    if not isnan(w.steer_voltage):
        steer_voltage = clip(w.steer_voltage, 0.0, 2 * NEUTRAL_V)
    return LoopsState(driven, steering, brake), (steer_voltage, pedal_voltage, share)
