"""Interface of the state estimators, and diagnostics that do not need the true state.

An estimator is an immutable object with the keys of `[estimator]`. `init(x, y, yaw, tractor) -> state` is called once,
and `update(state, measurement, dt) -> (state, estimate)` once per tick. `Health` contains the time of the newest
accepted fix and the smoothed normalised innovation squared (NIS). SI units and radians.
"""

from math import exp, sqrt
from typing import Any, NamedTuple

from agrobot_mj.core.calls import Linked
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, kernel_method, shared
from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Array, Column, Estimate, Fix, Measurement, Vector
from agrobot_mj.machine.tractor import TractorParameters

NIS_WINDOW_S = 5.0
"""Time constant for smoothing the normalised innovation squared (NIS) [s]. Assumed value: the duration of 100 fixes,
for which the smoothed NIS of a consistent filter stays below 2.6."""
NIS_MOST = 200.0
"""Upper limit applied to the normalised innovation squared (NIS) of a fix before smoothing [-]. Assumed value: 14
standard deviations. A single outlier then adds 2 to the smoothed NIS, and 5 s of outliers add 126."""


class Health(NamedTuple):
    """Diagnostics of an estimator, computed without the true state."""

    fix_t: float = 0.0  # Time of the newest accepted fix, or of the start of the run before the first accepted fix [s]
    nis: float = 2.0
    """Smoothed normalised innovation squared (NIS) of the position [-]; its mean is 2 for a consistent filter."""

    def after(self, nis: float, fix_t: float, dt: float) -> "Health":
        """Return the diagnostics `dt` [s] later. NaN values of `nis` and of the accepted fix time `fix_t` [s] are
        ignored."""
        keep = exp(-dt / NIS_WINDOW_S)
        smooth = keep * self.nis + (1.0 - keep) * min(nis, NIS_MOST) if nis == nis else self.nis
        return Health(fix_t if fix_t == fix_t else self.fix_t, smooth)


kernel_method("after")


class Readings(NamedTuple):
    """Measurements of a tick except the fix, as numbers for compiled kernels; a missing measurement is NaN."""

    t: float  # Time of the measurements [s]
    gyro: float  # Yaw rate [rad/s]
    wheel: float  # Wheel speed [m/s]
    steer: float  # Steering angle [rad]
    roll: float  # Roll [rad]
    pitch: float  # Pitch [rad]

    @classmethod
    def of(cls, m: Measurement) -> "Readings":
        """Return the measurements `m` of a tick, except the fix, as numbers for compiled kernels."""
        return cls(m.t, m.gyro, m.wheel_speed, m.steer, m.roll, m.pitch)


@shared
def largest_sigma(covariance: Array) -> float:
    """Return the maximum standard deviation over all directions [m] of the position, the first two states of
    `covariance`."""
    p_xx, p_xy, p_yy = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
    middle, half = 0.5 * (p_xx + p_yy), 0.5 * (p_xx - p_yy)
    return sqrt(middle + sqrt(half * half + p_xy * p_xy))


class StateEstimator(Reporting):
    """Base class of the state estimators; subclasses override `columns` and `report` to add log columns."""

    kind: str

    @property
    def needs(self) -> dict[str, str]:
        """Required sensors, each mapped to the scenario key that requires the sensor. Default: none."""
        return {}

    @property
    def interpreted(self) -> bool:
        """Whether compiled ticks must call the methods of the estimator. Default: True."""
        return True

    def init(self, x: float, y: float, yaw: float, tractor: TractorParameters) -> Any:
        """Return the initial state, with the rear axle (ground point R) at (x, y) [m] and the heading `yaw` [rad]."""
        raise NotImplementedError

    def update(self, state: Any, measurement: Measurement, dt: float) -> tuple[Any, Estimate]:
        """Return the new state and the estimate at the end of a tick of `dt` [s], from the measurement in this tick."""
        raise NotImplementedError


def estimator_form(
    settings: Held[Any], law: Held[Any], state: Held[Any], m: Readings, fix: Fix, quality: int, dt: float
) -> tuple[Held[Any], Held[Estimate], Vector]:
    """Define the signature of a compiled estimator. The function itself is never called.

    The arguments are the parameters of the estimator, the parameters of its pose filter or its waiting measurements,
    the state, the measurements and the fix (NaN if missing). The results are the new state, the estimate, and the
    values of the log columns.
    """
    raise NotImplementedError


class CompiledEstimator(StateEstimator):
    """Base class of the compiled estimators, which pass the estimate by reference to other compiled functions."""

    def update(self, state: Any, measurement: Measurement, dt: float) -> tuple[Any, Estimate]:
        """Return the new state and the estimate at the end of a tick of `dt` [s], from the measurement in this tick."""
        state, estimate = self.update_held(state, measurement, dt)
        return state, fetched(estimate)

    def update_held(self, state: Any, measurement: Measurement, dt: float) -> tuple[Any, Held[Estimate]]:
        """Return the new state, and a native reference (`Held`) to the estimate at the end of a tick of `dt` [s]."""
        raise NotImplementedError

    def compiled_tick(self, state: Any) -> Linked | None:
        """Return the compiled tick function, its parameters and its state, or None if the next tick needs Python."""
        return None

    def state_after_ticks(self, state: Any, found: Held[Any], shown: Vector) -> Any:
        """Return the state after ticks in compiled code. At their end, the state is `found` and the log values are
        `shown`."""
        return found


HEALTH_COLUMNS = (
    Column("accepted_fix_age", "s", "time since the newest fix accepted by the estimator"),
    Column("position_sigma", "m", "maximum estimated standard deviation of the rear-axle position over all directions"),
    Column("nis_mean", "-", "NIS of the position, smoothed over 5 s; 2 for a consistent filter"),
)
"""Log columns of the estimator's diagnostics: `Estimate.fix_age`, `position_sigma` and `nis_mean`."""
