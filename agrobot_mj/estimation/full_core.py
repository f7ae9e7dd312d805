"""Inputs, state and state resets of the filter of `ekf_full`."""

from math import sin, sqrt
from typing import NamedTuple

from agrobot_mj.core.signals import Array, Fix, Quality
from agrobot_mj.estimation.full_model import G_E, G_N, PSI, FixNoise, SideLoad, X, Y
from agrobot_mj.estimation.lever_arm import Lever
from agrobot_mj.estimation.sideslip_noise import SidewaysNoise
from agrobot_mj.estimation.wheel_slip import WheelSlip
from agrobot_mj.machine.tractor import GRAVITY


class Inputs(NamedTuple):
    """Measurements of a tick except the fix; a missing measurement is NaN."""

    t: float
    """Time of the measurements [s]."""
    gyro: float
    """Measured yaw rate [rad/s]."""
    wheel: float
    """Measured wheel speed [m/s]."""
    steer: float
    """Measured steering angle [rad]."""
    roll: float
    """Smoothed roll [rad]; 0 without compensation."""
    pitch: float
    """Smoothed pitch [rad]; 0 without compensation."""
    lean: tuple[float, float] = (0.0, 0.0)
    """Measured roll and pitch [rad]."""

    @property
    def side(self) -> float:
        """Gravity component of the specific side force [m/s2]."""
        return GRAVITY * sin(self.roll)


class Gates(NamedTuple):
    """Limits for rejecting a fix."""

    nis: float
    """NIS of a pair of innovations above which the pair is improbable [-]."""
    position: float
    """Maximum position innovation always accepted [m]."""
    velocity: float
    """Maximum velocity innovation always accepted [m/s]."""
    patience: int
    """Number of consecutive rejections before the filter restarts [ticks]."""


class Search(NamedTuple):
    """Sums for finding the initial yaw."""

    total: complex = 0j
    """Sum of wheel speed times fix velocity, rotated by minus the course chi [m2/s2]."""
    weight: float = 0.0
    """Sum of the squared wheel speeds [m2/s2]."""


class Core(NamedTuple):
    """Complete filter state at the time of its last tick."""

    mean: Array
    """Mean of the states, shape (14,), or (16,) after the first heading from two antennas."""
    covariance: Array
    """Covariance of `mean`, shape (n, n)."""
    search: Search | None = Search()
    """Search for the yaw; None after the search."""
    lever: Lever | None = None
    """Lever arm of the tilted antenna."""
    quality: int = Quality.FIX
    """Quality of the last fix."""
    standing: int = 0
    """Number of consecutive ticks with the wheels at rest."""
    refused_position: int = 0
    """Number of consecutive rejected positions."""
    refused_velocity: int = 0
    """Number of consecutive rejected velocities."""
    rejected_positions: int = 0
    """Number of rejected positions since the start."""
    rejected_velocities: int = 0
    """Number of rejected velocities since the start."""
    restarts: int = 0
    """Number of restarts of the position or of the search for the yaw."""
    seen_t: float = -1.0
    """Time of the last fix [s]."""
    accepted_t: float = 0.0
    """Time of the last accepted fix [s]; start of the run before the first accepted fix."""
    probation: int = 0
    """Number of consecutive consistent fixes required before fixes count as accepted again after a restart."""
    fix_speed: float = 0.0
    """Speed of the last fix [m/s]."""
    jumped: bool = False
    """Whether the fix speed has jumped since its last agreement with the wheel speed."""
    slip: WheelSlip = WheelSlip()
    """Estimated variation of the wheel slip."""
    sway: SidewaysNoise = SidewaysNoise()
    """Estimated random variation of the course."""
    steady: float = 0.0
    """Low-pass filtered modelled sideslip, positive to the right [rad]."""
    crab: float = 0.0
    """Mean excess sideslip: course of the fixes minus heading and modelled sideslip [rad]."""
    crab_s: float = 0.0
    """Averaging time of `crab` [s]."""
    cruise: float = 0.0
    """Low-pass filtered speed of the tractor [m/s]."""
    bend: float = 0.0
    """Low-pass filtered path curvature without the effect of bumps [1/m]."""
    nis: float = float("nan")
    """NIS of the position in the last tick; NaN without a fix [-]."""

    def side_load(self, gravity: float) -> SideLoad:
        """Return the inputs of the sideslip model for a `gravity` component of the specific side force [m/s2]."""
        return SideLoad(gravity, self.bend)


def alone(covariance: Array, index: int, sigma: float) -> Array:
    """Return the covariance with one state uncorrelated and its standard deviation set to `sigma`."""
    P = covariance.copy()
    P[index], P[:, index] = 0.0, 0.0
    P[index, index] = sigma * sigma
    return P


def forget_correlated(core: Core) -> Core:
    """Return the core with the correlated fix error reset to its stationary distribution, for a new fix quality."""
    mean = core.mean.copy()
    mean[[G_E, G_N]] = 0.0
    return core._replace(mean=mean, covariance=alone(alone(core.covariance, G_E, 1.0), G_N, 1.0))


def at_fix(core: Core, fix: Fix, noise: FixNoise) -> Core:
    """Return the core with position and position covariance reset to those of the fix."""
    core, sigma = forget_correlated(core), sqrt(noise.correlated**2 + noise.white**2)
    mean = core.mean.copy()
    mean[X], mean[Y] = fix.x, fix.y
    return core._replace(mean=mean, covariance=alone(alone(core.covariance, X, sigma), Y, sigma))


def turned(core: Core, angle: float, sigma: float) -> Core:
    """Return the core after the search: yaw rotated by `angle` [rad], with standard deviation `sigma` [rad]."""
    mean = core.mean.copy()
    mean[PSI] += angle
    return core._replace(mean=mean, covariance=alone(core.covariance, PSI, sigma), search=None)


def accepted(core: Core, t: float) -> Core:
    """Return the core after an accepted position at time `t` [s]."""
    if core.probation > 1:
        return core._replace(refused_position=0, probation=core.probation - 1)
    return core._replace(refused_position=0, probation=0, accepted_t=t)


def restarted(core: Core, fix: Fix, noise: FixNoise) -> Core:
    """Return the core restarted at the fix after too many rejections."""
    return at_fix(core, fix, noise)._replace(refused_position=0, restarts=core.restarts + 1)
