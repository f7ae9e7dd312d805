"""PID and the low-level loops: speed to pedal to voltage, steering angle to voltage; and the brake.

Both valves take 0-12 V with neutral at 6 V; above it the wheels steer left and the pedal goes forward. The
structure (two PIDs in cascade for the speed, an inner loop for the steering) is the paper's, section V-B; the
gains are estimates for the delays, lags and dead bands of `hydraulics` and `driveline`.

The brake is applied where standstill is asked for: by a law with a speed of exactly zero, by the supervisor's stop with
a pedal in neutral, and where the reference stands still and the law asks for no more than a crawl. The hydrostat slows
the tractor until then. The brake cuts the power of the pedal valve, stops the tractor and holds it. It is released as
soon as the tractor is asked to drive. While it holds a standing tractor, a law that follows a path does not steer: it
would answer the noise of its estimate, and turning wheels roll a parked tractor by millimetres.
"""

from math import inf, isfinite, radians
from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.control.base import AngleLoop
from agrobot_mj.core.signals import NEUTRAL_V, Command, Reference
from agrobot_mj.core.spec import NonNegative, Positive, Spec


def clip(x: float, low: float, high: float) -> float:
    """x within [low, high]."""
    return min(max(x, low), high)


class FilteredRate(NamedTuple):
    """A filtered derivative: the last value and its rate of change."""

    value: float | None = None
    """Filtered value; None before the first one [unit]."""
    rate: float = 0.0
    """Rate of change of the filtered value [unit/s]."""

    def after(self, value: float, dt: float, filter_s: float) -> "FilteredRate":
        """Update with the next value, dt [s] later, through a first-order filter of time constant `filter_s` [s]."""
        if self.value is None:
            return FilteredRate(value, 0.0)
        raw = (value - self.value) / dt
        return FilteredRate(value, self.rate + (raw - self.rate) * dt / (filter_s + dt))


class PidState(NamedTuple):
    """Memory of a `Pid`."""

    integral: float = 0.0
    """Contribution of the integral to the output [unit of the output]."""
    slope: FilteredRate = FilteredRate()
    """Filtered derivative of the error [unit of the error per s]."""


class Pid(Spec):
    """PID with a filtered derivative; units are those of the loop it serves."""

    kp: float = 1.0
    """Proportional gain [output/error]. Assumed value: tuned."""
    ki: float = 0.0
    """Integral gain [output/(error s)]. Assumed value: tuned."""
    kd: float = 0.0
    """Derivative gain [output s/error]. Assumed value: tuned."""
    derivative_filter_s: NonNegative = 0.1
    """Time constant of the derivative's filter [s]. Assumed value: a tick or two."""

    def init(self) -> PidState:
        """State at rest."""
        return PidState()

    def update(
        self, state: PidState, error: float, dt: float, low: float, high: float, ahead: float = 0.0
    ) -> tuple[PidState, float]:
        """Output within [low, high] after dt [s]; `ahead` is a feed-forward term in the unit of the output.

        Anti-windup: the integral is held while it would push the output further into its limit.
        """
        slope = state.slope.after(error, dt, self.derivative_filter_s)
        direct = ahead + self.kp * error + self.kd * slope.rate
        step = self.ki * error * dt
        wanted = direct + state.integral + step
        winding = (wanted > high and step > 0) or (wanted < low and step < 0)
        integral = state.integral if winding else state.integral + step
        return PidState(integral, slope), clip(direct + integral, low, high)


def over_dead_band(error: float, jump: float, tolerance: float) -> float:
    """Voltage [V] that carries a valve over its dead band.

    0 for errors below `tolerance`, from there a ramp up to `jump` at twice the tolerance.
    """
    size = jump * clip(abs(error) / tolerance - 1, 0.0, 1.0)
    return size if error > 0 else -size


class SpeedState(NamedTuple):
    """Memory of the two PIDs."""

    outer: PidState
    inner: PidState
    reference: float = 0.0
    """Present reference of the inner loop [-]."""


class SpeedLoop(Spec):
    """Speed error -> pedal reference -> voltage, two PIDs in cascade (paper, section V-B).

    Gains on speeds that are not given go with the inverse of the machine's full speed.
    """

    sized: ClassVar = {key: {"speed": -1} for key in ("feedforward_s_m", "outer.kp", "outer.ki")}

    outer: Pid = Pid(kp=0.05, ki=0.1)
    """Speed [m/s] to pedal reference [-]. Assumed value."""
    inner: Pid = Pid(kp=6.0)
    """Pedal [-] to voltage [V]. Assumed value."""
    feedforward_s_m: NonNegative = 0.2
    """Pedal per unit of speed reference [s/m]: 0.2 is full pedal at 5 m/s. Assumed value: without it the outer PID
    needs gains that make the speed oscillate on compliant tyres."""
    deadband_compensation_v: NonNegative = 0.25
    """Jump over the valve's dead band [V]. Assumed value: below the band itself, or the loop hunts."""
    tolerance: Positive = 0.005
    """Pedal error that is not corrected [-]. Assumed value: below the potentiometer's noise."""

    def init(self) -> SpeedState:
        """State at rest."""
        return SpeedState(self.outer.init(), self.inner.init())

    def update(
        self, state: SpeedState, speed_ref: float, speed: float, pedal: float, dt: float
    ) -> tuple[SpeedState, tuple[float, float]]:
        """Pedal reference in [-1, 1] and pedal valve voltage [V] from speeds [m/s] and pedal position [-]."""
        ahead = self.feedforward_s_m * speed_ref
        outer, pedal_ref = self.outer.update(state.outer, speed_ref - speed, dt, -1.0, 1.0, ahead)
        return self.hold(SpeedState(outer, state.inner), pedal_ref, pedal, dt)

    def hold(
        self, state: SpeedState, pedal_ref: float, pedal: float, dt: float
    ) -> tuple[SpeedState, tuple[float, float]]:
        """Run the inner loop alone: the given pedal reference, and the pedal valve voltage [V]."""
        error = pedal_ref - pedal
        jump = over_dead_band(error, self.deadband_compensation_v, self.tolerance)
        inner, voltage = self.inner.update(state.inner, error, dt, -NEUTRAL_V, NEUTRAL_V, jump)
        return SpeedState(state.outer, inner, pedal_ref), (pedal_ref, NEUTRAL_V + voltage)


class SteeringState(NamedTuple):
    """Memory of a `SteeringLoop`."""

    pid: PidState
    reference: float = 0.0
    """Present reference angle of the loop, limited in rate [rad]."""


class SteeringLoop(AngleLoop):
    """Steering angle error -> valve voltage."""

    kind: Literal["pid"] = "pid"
    pid: Pid = Pid(kp=20.0, ki=3.0, kd=2.0, derivative_filter_s=0.05)
    """Angle [rad] to voltage [V]. Assumed value."""
    deadband_compensation_v: NonNegative = 0.3
    """Jump over the valve's dead band [V]. Assumed value: below the band itself, or the loop hunts."""
    tolerance_deg: Positive = 0.1
    """Angle error that is not corrected [deg]. Assumed value, below the potentiometer's 1 deg."""
    reference_rate_deg_s: Positive | None = None
    """Largest rate of the reference [deg/s]; without it the reference is the yaw controller's output, as in the paper.
    The valve itself reaches 26 deg/s; a limit there removes the jump in the command when GNSS comes back."""

    def init(self) -> SteeringState:
        """State at rest, straight ahead."""
        return SteeringState(self.pid.init())

    def update(self, state: SteeringState, wanted: float, steer: float, dt: float) -> tuple[SteeringState, float]:
        """Steering valve voltage [V] from the commanded and the measured angle [rad]."""
        steer_ref = self._reference(state.reference, wanted, dt)
        error = steer_ref - steer
        jump = over_dead_band(error, self.deadband_compensation_v, radians(self.tolerance_deg))
        pid, voltage = self.pid.update(state.pid, error, dt, -NEUTRAL_V, NEUTRAL_V, jump)
        return SteeringState(pid, steer_ref), NEUTRAL_V + voltage

    def _reference(self, last: float, wanted: float, dt: float) -> float:
        """Reference angle [rad], `dt` [s] after `last`, moving towards `wanted` at the limited rate."""
        if self.reference_rate_deg_s is None:
            return wanted
        reach = radians(self.reference_rate_deg_s) * dt
        return clip(wanted, last - reach, last + reach)


STANDSTILL_S = 1.0
"""Time for which standstill is asked for before the brake is applied: three lags of the pump [s]. Assumed value."""
STOPPED_S = 2.0
"""Time after which the brake has stopped the tractor [s]. Assumed value: twice its time from field speed."""
CRAWL_M_S = 0.1
"""Speed up to which a law that regulates its distance from a standing reference is content [m/s]. Assumed value: that
of the GNSS noise."""


class BrakeState(NamedTuple):
    """Memory of the brake; before the first tick the tractor is parked."""

    standing_s: float = inf
    """Time for which standstill has been asked for [s]."""

    @property
    def share(self) -> float:
        """Share of the brake's torque that is applied, 0 or 1 [-]."""
        return 1.0 if self.standing_s >= STANDSTILL_S else 0.0

    @property
    def stands(self) -> bool:
        """Whether the brake has stopped the tractor and holds it."""
        return self.standing_s >= STANDSTILL_S + STOPPED_S

    def after(self, command: Command, reference: Reference, dt: float) -> "BrakeState":
        """State `dt` [s] later, under the command that the low-level loops get, beside the reference of the path."""
        asked = command.speed if command.pedal is None else command.pedal
        if asked == 0.0:
            return BrakeState(self.standing_s + dt)
        crawls = command.pedal is None and abs(asked) < CRAWL_M_S and reference.vx == reference.vy == 0.0
        # a path that begins at rest sets off at once: only the time of the run counts
        return BrakeState((self.standing_s if isfinite(self.standing_s) else 0.0) + dt if crawls else 0.0)
