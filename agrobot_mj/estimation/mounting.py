"""Mounting error of a two-antenna heading, distinguished from sideslip by its magnitude.

On a straight line only the sum of sideslip and mounting error is observable: the course minus the measured heading.
Sideslip of several degrees does not occur on level ground. If the mean of the sum over `WINDOW_S` exceeds `CRAB` plus
the effect of the turn offset in a bend, the sum is attributed to the mounting error, which becomes an estimated state.
If a faulty receiver repeats a heading, the sum is large and varies in bends; a varying sum is ignored.
"""

from math import atan2, isfinite, pi, radians

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import Fix, Matrix, Vector
from agrobot_mj.estimation.full_core import Core, Crab, alone
from agrobot_mj.estimation.full_model import BETA, MOUNT, PSI, N, SideLoad, V, modelled_crab

CRAB = radians(3.0)
"""Maximum steady unmodelled sideslip [rad]. Assumed value for implement draught, or a slope of 20 deg without IMU."""
TURN_OFFSET = 0.5
"""Maximum turn offset: distance of the rear axle ahead of the point without sideslip [m]. The offset times the
curvature is added to `CRAB`. Assumed value; deep ruts cause 0.35 m."""
WINDOW_S = 5.0
"""Averaging time of the sum of sideslip and mounting error [s]. Assumed value; noise and bumps then cause 0.3 deg."""
LATE_S = 1.5  # Averaging time that suppresses the oscillation of the antenna on rough ground [s]. Assumed value.
STEADY, SPREAD = 0.12, radians(3.0)
"""Maximum standard deviation of the unmodelled sideslip averaged over `LATE_S`: relative to its mean over `WINDOW_S`
[-], and absolute [rad]. Assumed values: rough ground causes 1-2 deg, and a repeated heading in a bend causes 0.18 of
the mean."""
MOST = radians(30.0)  # Maximum mounting error [rad]. Assumed value: three times `MOUNT_SIGMA`.
MOUNT_SIGMA = radians(10.0)
"""Initial standard deviation of the mounting error [rad]. Assumed value for antennas aligned by eye."""
SIGMA = radians(0.5)
"""Standard deviation of heading and sideslip [rad] at the start of the mounting estimate. Assumed value: with larger
values, the filter would attribute slow errors of the fixes to antenna tilt that rotates with the heading."""
MOVING = 0.5  # Minimum speed for a valid course [m/s]. Assumed value: fifteen times the velocity noise.


@jit
def with_crab(core: Core, fix: Fix, side: SideLoad, dt: float) -> Crab:
    """Return the averaged unmodelled sideslip after a fix at the rear axle, `dt` [s] after the previous fix."""
    v = core.mean[V]
    if core.mean.size == N or core.search.active or abs(v) < MOVING or not isfinite(fix.heading):
        return core.crab
    course = atan2(fix.vy, fix.vx) + (pi if v < 0.0 else 0.0)
    crab = wrap(course - fix.heading + core.mean[MOUNT] + modelled_crab(core.mean, v, side))
    time = min(core.crab.time + dt, WINDOW_S)
    before = core.crab
    mean = before.mean + (crab - before.mean) * dt / time
    late = before.late + (crab - before.late) * dt / min(time, LATE_S)
    variance = before.variance + ((late - mean) * (late - mean) - before.variance) * dt / time
    return Crab(mean, time, late, variance)


@jit
def implausible(crab: Crab, bend: float) -> bool:
    """Return whether the mean unmodelled sideslip is too large for any ground at the curvature `bend` [1/m]."""
    return abs(crab.mean) > CRAB + TURN_OFFSET * abs(bend)


@jit
def with_mounting(mean: Vector, covariance: Matrix, crab: Crab, bend: float) -> tuple[Vector, Matrix, Crab]:
    """Attribute an implausible but steady unmodelled sideslip to the mounting error of the antennas.

    Return the mean, the covariance and the remaining unmodelled sideslip.
    """
    if crab.time < WINDOW_S or not implausible(crab, bend):
        return mean, covariance, crab
    spread = min(STEADY * abs(crab.mean), SPREAD)
    if crab.variance > spread * spread or abs(mean[MOUNT] - crab.mean) > MOST:
        return mean, covariance, crab
    mean, P = mean.copy(), alone(covariance, PSI, SIGMA)
    mean[PSI] += crab.mean
    mean[MOUNT], mean[BETA] = mean[MOUNT] - crab.mean, 0.0
    return mean, alone(alone(P, BETA, SIGMA), MOUNT, MOUNT_SIGMA), Crab(0.0, 0.0, 0.0, 0.0)
