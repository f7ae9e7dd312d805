"""Mounting error of two antennas, told from sideslip by its size: no level ground explains a crab of several degrees.

On a straight line only the sum of sideslip and mounting error is observable, the course less the measured heading. A
sum above `CRAB`, plus the effect of the turn offset in a bend, over `WINDOW_S` is assigned to the mounting, which then
becomes a state of the filter. A smaller sum counts as sideslip.
"""

from math import atan2, isfinite, pi, radians

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Fix
from agrobot_mj.estimation.full_core import Core, alone
from agrobot_mj.estimation.full_model import BETA, MOUNT, PSI, N, SideLoad, V, modelled_crab

CRAB = radians(3.0)
"""Largest steady sideslip beyond the model [rad]. Assumed value: 20 deg across a slope without an inertial unit;
draught."""
TURN_OFFSET = 0.5
"""Largest offset of the turn, which adds to it times the curvature [m]. Assumed value: 0.35 in deep ruts."""
WINDOW_S = 5.0
"""Time over which the sum is averaged [s]. Assumed value: noise of a velocity and of bumps down to 0.3 deg."""
MOUNT_SIGMA = radians(10.0)
"""Standard deviation of the mounting error as it becomes a state [rad]. Assumed value: antennas placed by eye."""
SIGMA = radians(0.5)
"""Standard deviation of heading and sideslip then [rad]. Assumed value: a larger one lets a lean of the antenna, which
turns with the heading, explain the slow errors of the fixes."""
MOVING = 0.5
"""Speed below which there is no course [m/s]. Assumed value: fifteen times the noise of a velocity."""


def with_crab(core: Core, fix: Fix, side: SideLoad, dt: float) -> Core:
    """State with the mean sideslip beyond the modelled one that the fix of R, after `dt` [s], shows."""
    v = float(core.mean[V])
    if len(core.mean) == N or core.search is not None or abs(v) < MOVING or not isfinite(fix.heading):
        return core
    course = atan2(fix.vy, fix.vx) + (pi if v < 0.0 else 0.0)
    crab = wrap(course - fix.heading + float(core.mean[MOUNT]) + modelled_crab(core.mean, v, side))
    seen = min(core.crab_s + dt, WINDOW_S)
    return core._replace(crab=core.crab + (crab - core.crab) * dt / seen, crab_s=seen)


def implausible(core: Core) -> bool:
    """Whether the mean sideslip is larger than any ground explains."""
    return abs(core.crab) > CRAB + TURN_OFFSET * abs(core.bend)


def with_mounting(core: Core) -> Core:
    """State with the mounting error as a state once it shows."""
    if core.crab_s < WINDOW_S or not implausible(core):
        return core
    mean, P = core.mean.copy(), core.covariance
    mean[PSI] += core.crab
    mean[MOUNT], mean[BETA] = mean[MOUNT] - core.crab, 0.0
    for state, sigma in ((PSI, SIGMA), (BETA, SIGMA), (MOUNT, MOUNT_SIGMA)):
        P = alone(P, state, sigma)
    return core._replace(mean=mean, covariance=P, crab=0.0, crab_s=0.0)
