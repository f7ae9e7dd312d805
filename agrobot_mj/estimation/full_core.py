"""Inputs, state and state resets of the Kalman filter in the estimator `ekf_full`."""

from math import nan, sin, sqrt
from typing import NamedTuple

from agrobot_mj.core.kernels import jit, shared
from agrobot_mj.core.signals import Fix, Matrix, Quality, Vector
from agrobot_mj.estimation.full_model import G_E, G_N, PSI, FixNoise, X, Y
from agrobot_mj.estimation.lever_arm import UNKNOWN, Lever
from agrobot_mj.estimation.sideslip_noise import SidewaysNoise
from agrobot_mj.estimation.wheel_slip import WheelSlip
from agrobot_mj.machine.tractor import GRAVITY


class Inputs(NamedTuple):
    """Measurements of a tick except the fix, for the filter of `ekf_full`.

    A missing yaw rate, wheel speed or steering angle is NaN. A missing roll or pitch keeps its last value, initially 0.
    """

    t: float  # Time of the measurements [s]
    gyro: float  # Measured yaw rate [rad/s]
    wheel: float  # Measured wheel speed [m/s]
    steer: float  # Measured steering angle [rad]
    roll: float  # Smoothed roll [rad], or 0 if there is no terrain compensation
    pitch: float  # Smoothed pitch [rad], or 0 if there is no terrain compensation
    lean: tuple[float, float] = (0.0, 0.0)  # Measured roll and pitch without smoothing [rad]


@shared
def side_of(inputs: Inputs) -> float:
    """Return the specific side force due to gravity on a side slope [m/s2]."""
    return GRAVITY * sin(inputs.roll)


class Gates(NamedTuple):
    """Limits above which the innovations of a fix are rejected as outliers."""

    nis: float  # NIS above which the position or the velocity of a fix is improbable [-]
    position: float  # Position innovation up to which every fix is accepted [m]
    velocity: float  # Velocity innovation up to which every fix is accepted [m/s]
    patience: int  # Number of consecutive rejections before the filter restarts [ticks]


class Search(NamedTuple):
    """State of the search for the initial yaw.

    The search sums products of wheel speed and fix velocity, along and across the predicted course.
    """

    active: bool = True  # Whether the yaw is unknown
    along: float = 0.0  # Sum of wheel speed times fix velocity along the predicted course [m2/s2]
    across: float = 0.0  # Sum of wheel speed times fix velocity to the left of the predicted course [m2/s2]
    weight: float = 0.0  # Sum of the squared wheel speeds [m2/s2]


FOUND = Search(active=False)  # State of the yaw search after the yaw has been found


class Rejections(NamedTuple):
    """Numbers of accepted and rejected fixes, and time of the last accepted fix."""

    accepted_t: float = 0.0
    """Time of the last accepted fix [s]; before the first accepted fix, the start of the run."""
    probation: int = 0
    """Number of consecutive consistent fixes still required after a restart before a fix counts as accepted again."""
    position: int = 0  # Number of consecutive fixes with a rejected position
    velocity: int = 0  # Number of consecutive fixes with a rejected velocity
    positions: int = 0  # Number of fixes with a rejected position since the start
    velocities: int = 0  # Number of fixes with a rejected velocity since the start
    restarts: int = 0  # Number of restarts of the position or of the search for the yaw


class Seen(NamedTuple):
    """Time, quality and speed of the last fix, and whether the speed of the fixes has jumped."""

    t: float = -1.0  # Time of the last fix [s]
    quality: int = Quality.FIX  # Quality of the last fix
    speed: float = 0.0  # Speed of the last fix [m/s]
    jumped: bool = False  # Whether the fix speed has jumped since its last agreement with the wheel speed


class Smooth(NamedTuple):
    """Low-pass filtered motion of the tractor."""

    standing: int = 0  # Number of consecutive ticks with the wheels at rest
    cruise: float = 0.0  # Low-pass filtered speed of the tractor [m/s]
    steady: float = 0.0  # Low-pass filtered modelled sideslip [rad], positive to the right
    bend: float = 0.0  # Low-pass filtered path curvature [1/m], without the effect of bumps


class Crab(NamedTuple):
    """Unmodelled sideslip from a two-antenna heading: course of the fixes minus heading minus modelled sideslip."""

    mean: float = 0.0  # Mean unmodelled sideslip [rad]
    time: float = 0.0  # Duration of the averaging of `mean` so far [s]
    late: float = 0.0  # Mean unmodelled sideslip of the last seconds [rad]
    variance: float = 0.0  # Mean squared difference between `late` and `mean` [rad2]


class Core(NamedTuple):
    """Complete state of the filter after its last tick."""

    mean: Vector  # Mean of the states, shape (14,), or (16,) after the first heading from two antennas
    covariance: Matrix  # Covariance of `mean`, shape (n, n)
    search: Search = Search()  # Search for the initial yaw
    lever: Lever = UNKNOWN  # Lever arm of the antenna on the tilted tractor
    rejections: Rejections = Rejections()  # Counts of accepted and rejected fixes
    seen: Seen = Seen()  # Properties of the last fix
    smooth: Smooth = Smooth()  # Low-pass filtered motion
    slip: WheelSlip = WheelSlip()  # Estimated variation of the wheel slip
    sway: SidewaysNoise = SidewaysNoise()
    """Random variation of the course in addition to the modelled sideslip, estimated from the fixes."""
    crab: Crab = Crab()  # Unmodelled sideslip with a two-antenna heading
    nis: float = nan  # Normalised innovation squared of the position in the last tick [-], or NaN if there is no fix


@jit
def alone(covariance: Matrix, index: int, sigma: float) -> Matrix:
    """Return `covariance` after decoupling the state `index` from all other states and setting its standard
    deviation."""
    P = covariance.copy()
    for other in range(P.shape[0]):
        P[index, other] = P[other, index] = 0.0
    P[index, index] = sigma * sigma
    return P


@jit
def forget_correlated(mean: Vector, covariance: Matrix) -> tuple[Vector, Matrix]:
    """Return the mean and covariance after resetting the correlated fix error to its stationary distribution."""
    mean = mean.copy()
    mean[G_E] = mean[G_N] = 0.0
    return mean, alone(alone(covariance, G_E, 1.0), G_N, 1.0)


@jit
def at_fix(mean: Vector, covariance: Matrix, fix: Fix, noise: FixNoise) -> tuple[Vector, Matrix]:
    """Return the mean and covariance after moving the position to the fix, whose position error is `noise`."""
    mean, P = forget_correlated(mean, covariance)
    sigma = sqrt(noise.correlated * noise.correlated + noise.white * noise.white)
    mean[X], mean[Y] = fix.x, fix.y
    return mean, alone(alone(P, X, sigma), Y, sigma)


@jit
def rotate_yaw(mean: Vector, covariance: Matrix, angle: float, sigma: float) -> tuple[Vector, Matrix]:
    """Return mean and covariance with the yaw rotated by `angle` and its standard deviation set to `sigma` [rad]."""
    mean = mean.copy()
    mean[PSI] += angle
    return mean, alone(covariance, PSI, sigma)


@shared
def count_accepted_fix(r: Rejections, t: float) -> Rejections:
    """Return the rejection counts `r` after a fix whose position has been accepted at time `t` [s]."""
    since = r.accepted_t if r.probation > 1 else t
    return Rejections(since, max(r.probation - 1, 0), 0, r.velocity, r.positions, r.velocities, r.restarts)
