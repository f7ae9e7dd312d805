"""Inputs and state of the filter of `ekf_full`, and resets of the state."""

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
    """Roll after smoothing, 0 without compensation [rad]."""
    pitch: float
    """Pitch after smoothing, 0 without compensation [rad]."""
    lean: tuple[float, float] = (0.0, 0.0)
    """Measured roll and pitch [rad]."""

    @property
    def side(self) -> float:
        """Gravity component of the specific side force [m/s2]."""
        return GRAVITY * sin(self.roll)


class Gates(NamedTuple):
    """Limits above which a fix is rejected."""

    nis: float
    """NIS of a pair of innovations above which the pair is improbable [-]."""
    position: float
    """Position innovation up to which a fix is always accepted [m]."""
    velocity: float
    """Velocity innovation up to which a fix is always accepted [m/s]."""
    patience: int
    """Number of consecutive rejections after which the filter restarts [ticks]."""


class Search(NamedTuple):
    """Sums for the search of the initial yaw."""

    total: complex = 0j
    """Sum of wheel speed times fix velocity, rotated by the negative course chi [m2/s2]."""
    weight: float = 0.0
    """Sum of the squared wheel speeds [m2/s2]."""


class Core(NamedTuple):
    """Complete filter state at the time of its last tick."""

    mean: Array
    """Mean of the states, shape (14,), or (16,) after the first heading from two antennas."""
    covariance: Array
    """Covariance of `mean`, shape (n, n)."""
    search: Search | None = Search()
    """Search for the yaw; None once it is found."""
    lever: Lever | None = None
    """Lever arm of the tilted antenna."""
    quality: int = Quality.FIX
    """Quality of the last fix."""
    standing: int = 0
    """Number of consecutive ticks with wheels at rest."""
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
    """Time of the last accepted fix; start of the run before the first one [s]."""
    probation: int = 0
    """Number of consecutive consistent fixes still required after a restart before a fix counts as accepted."""
    fix_speed: float = 0.0
    """Speed of the last fix [m/s]."""
    jumped: bool = False
    """Whether the fix speed has jumped since it last agreed with the wheel speed."""
    slip: WheelSlip = WheelSlip()
    """Estimated variation of the wheel slip."""
    sway: SidewaysNoise = SidewaysNoise()
    """Estimated random variation of the course."""
    steady: float = 0.0
    """Low-pass filtered modelled sideslip, positive to the right [rad]."""
    crab: float = 0.0
    """Mean of the fixes' course minus heading and modelled sideslip [rad]."""
    crab_s: float = 0.0
    """Averaging time of the mean excess sideslip `crab` [s]."""
    cruise: float = 0.0
    """Low-pass filtered speed of the tractor [m/s]."""
    bend: float = 0.0
    """Low-pass filtered path curvature, without bumps [1/m]."""
    nis: float = float("nan")
    """NIS of the position in the last tick; NaN without a fix."""

    def side_load(self, gravity: float) -> SideLoad:
        """Return the inputs of the sideslip model, with the `gravity` component of the specific side force [m/s2]."""
        return SideLoad(gravity, self.bend)


def alone(covariance: Array, index: int, sigma: float) -> Array:
    """Return the covariance with the standard deviation of one state reset and its correlations removed."""
    P = covariance.copy()
    P[index], P[:, index] = 0.0, 0.0
    P[index, index] = sigma * sigma
    return P


def forget_correlated(core: Core) -> Core:
    """Return the core with the correlated fix error reset to its stationary distribution, for another fix quality."""
    mean = core.mean.copy()
    mean[[G_E, G_N]] = 0.0
    return core._replace(mean=mean, covariance=alone(alone(core.covariance, G_E, 1.0), G_N, 1.0))


def at_fix(core: Core, fix: Fix, noise: FixNoise) -> Core:
    """Return the core with the position and its uncertainty reset to those of the fix."""
    core, sigma = forget_correlated(core), sqrt(noise.correlated**2 + noise.white**2)
    mean = core.mean.copy()
    mean[X], mean[Y] = fix.x, fix.y
    return core._replace(mean=mean, covariance=alone(alone(core.covariance, X, sigma), Y, sigma))


def turned(core: Core, angle: float, sigma: float) -> Core:
    """Return the core after the search: yaw corrected by `angle` [rad] with standard deviation `sigma` [rad]."""
    mean = core.mean.copy()
    mean[PSI] += angle
    return core._replace(mean=mean, covariance=alone(core.covariance, PSI, sigma), search=None)


def accepted(core: Core, t: float) -> Core:
    """Return the core after a position that passed the gate at time `t` [s]."""
    if core.probation > 1:
        return core._replace(refused_position=0, probation=core.probation - 1)
    return core._replace(refused_position=0, probation=0, accepted_t=t)


def restarted(core: Core, fix: Fix, noise: FixNoise) -> Core:
    """Return the core restarted at the fix after too many rejections."""
    return at_fix(core, fix, noise)._replace(refused_position=0, restarts=core.restarts + 1)
