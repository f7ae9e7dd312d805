"""Mounting error of two antennas, distinguished from sideslip by its magnitude.

On a straight line only the sum of sideslip and mounting error is observable: the course minus the measured heading.
Sideslip of several degrees does not occur on level ground. If the mean of the sum over `WINDOW_S` exceeds `CRAB` plus
the effect of the turn offset in a bend, the filter assigns it to the mounting error, which becomes an estimated state.
"""

from math import atan2, isfinite, pi, radians

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Fix
from agrobot_mj.estimation.full_core import Core, alone
from agrobot_mj.estimation.full_model import BETA, MOUNT, PSI, N, SideLoad, V, modelled_crab

CRAB = radians(3.0)
"""Maximum steady sideslip beyond the model [rad]. Assumed value for draught or a 20 deg side slope without IMU."""
TURN_OFFSET = 0.5
"""Maximum turn offset [m]; its product with the curvature is added to `CRAB`. Assumed value; 0.35 in deep ruts."""
WINDOW_S = 5.0
"""Averaging time of the sum of sideslip and mounting error [s]. Assumed value; noise and bumps then cause 0.3 deg."""
MOUNT_SIGMA = radians(10.0)
"""Initial standard deviation of the mounting error [rad]. Assumed value for antennas aligned by eye."""
SIGMA = radians(0.5)
"""Standard deviation of heading and sideslip when the mounting error becomes a state [rad]. Assumed value: with larger
values, antenna tilt that rotates with the heading would account for the slow errors of the fixes."""
MOVING = 0.5
"""Minimum speed for a valid course [m/s]. Assumed value, fifteen times the velocity noise."""


def with_crab(core: Core, fix: Fix, side: SideLoad, dt: float) -> Core:
    """Return the core with its mean excess sideslip updated by a rear-axle fix, `dt` [s] after the previous fix."""
    v = float(core.mean[V])
    if len(core.mean) == N or core.search is not None or abs(v) < MOVING or not isfinite(fix.heading):
        return core
    course = atan2(fix.vy, fix.vx) + (pi if v < 0.0 else 0.0)
    crab = wrap(course - fix.heading + float(core.mean[MOUNT]) + modelled_crab(core.mean, v, side))
    time = min(core.crab_s + dt, WINDOW_S)
    return core._replace(crab=core.crab + (crab - core.crab) * dt / time, crab_s=time)


def implausible(core: Core) -> bool:
    """Return whether the mean excess sideslip is too large for any ground."""
    return abs(core.crab) > CRAB + TURN_OFFSET * abs(core.bend)


def with_mounting(core: Core) -> Core:
    """Return the core with the mounting error as an estimated state if the excess sideslip is implausible."""
    if core.crab_s < WINDOW_S or not implausible(core):
        return core
    mean, P = core.mean.copy(), core.covariance
    mean[PSI] += core.crab
    mean[MOUNT], mean[BETA] = mean[MOUNT] - core.crab, 0.0
    for state, sigma in ((PSI, SIGMA), (BETA, SIGMA), (MOUNT, MOUNT_SIGMA)):
        P = alone(P, state, sigma)
    return core._replace(mean=mean, covariance=P, crab=0.0, crab_s=0.0)
