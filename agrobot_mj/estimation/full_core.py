"""What the filter of `ekf_full` reads and remembers between two ticks, and how its belief restarts."""

from math import sin, sqrt
from typing import NamedTuple

from agrobot_mj.core.signals import Array, Fix, Quality
from agrobot_mj.estimation.full_model import G_E, G_N, PSI, FixNoise, SideLoad, X, Y
from agrobot_mj.estimation.lever_arm import Lever
from agrobot_mj.estimation.sideslip_noise import SidewaysNoise
from agrobot_mj.estimation.wheel_slip import WheelSlip
from agrobot_mj.machine.tractor import GRAVITY


class Inputs(NamedTuple):
    """What a tick measures besides the fix; a reading that is not there is NaN."""

    t: float
    """Time of the readings [s]."""
    gyro: float
    """Yaw rate [rad/s]."""
    wheel: float
    """Wheel speed [m/s]."""
    steer: float
    """Steering angle [rad]."""
    roll: float
    """Roll without its noise, 0 without compensation [rad]."""
    pitch: float
    """Pitch without its noise, 0 without compensation [rad]."""
    lean: tuple[float, float] = (0.0, 0.0)
    """Roll and pitch as they are read [rad]."""

    @property
    def side(self) -> float:
        """Part of gravity in the specific side force [m/s2]."""
        return GRAVITY * sin(self.roll)


class Gates(NamedTuple):
    """Limits beyond which a fix is refused."""

    nis: float
    """NIS of a pair above which it is improbable [-]."""
    position: float
    """Position innovation that is always believed [m]."""
    velocity: float
    """Velocity innovation that is always believed [m/s]."""
    patience: int
    """Refusals in a row after which the filter gives in [ticks]."""


class Search(NamedTuple):
    """Search for the yaw."""

    total: complex = 0j
    """Sum of w V exp(-i chi) [m2/s2]."""
    weight: float = 0.0
    """Sum of w^2 [m2/s2]."""


class Core(NamedTuple):
    """All that the filter believes and remembers at the time of its last tick."""

    mean: Array
    """Mean of the states, shape (14,), or (16,) after the first heading from two antennas."""
    covariance: Array
    """Covariance of `mean`."""
    search: Search | None = Search()
    """Search for the yaw; None once it is found."""
    lever: Lever | None = None
    """Lean of the antenna, with compensation."""
    quality: int = Quality.FIX
    """Quality of the last fix."""
    standing: int = 0
    """Ticks in a row with wheels that stand."""
    refused_position: int = 0
    """Positions refused in a row."""
    refused_velocity: int = 0
    """Velocities refused in a row."""
    rejected_positions: int = 0
    """Positions refused since the start."""
    rejected_velocities: int = 0
    """Velocities refused since the start."""
    restarts: int = 0
    """How often the position was restarted or the search for the yaw repeated."""
    seen_t: float = -1.0
    """Time of the last fix [s]."""
    accepted_t: float = 0.0
    """Time of the last accepted fix, the start before the first [s]."""
    probation: int = 0
    """Consecutive fixes without a refusal that are still due, after a restart, until one counts as accepted."""
    fix_speed: float = 0.0
    """Speed of the last fix [m/s]."""
    leapt: bool = False
    """Whether the fixes' speed has jumped since it last agreed with the wheels'."""
    slip: WheelSlip = WheelSlip()
    """How much the slip of the wheels changes."""
    sway: SidewaysNoise = SidewaysNoise()
    """How much the course sways about the modelled one."""
    steady: float = 0.0
    """Modelled sideslip without its changes, to the right positive [rad]."""
    crab: float = 0.0
    """Mean of the fixes' course less their heading and the modelled sideslip [rad]."""
    crab_s: float = 0.0
    """Time over which that is the mean [s]."""
    cruise: float = 0.0
    """Speed without the noise of single readings [m/s]."""
    bend: float = 0.0
    """Curvature of the bend, without that noise and without bumps [1/m]."""
    nis: float = float("nan")
    """NIS of the position of the last tick, NaN without a fix."""

    def side_load(self, gravity: float) -> SideLoad:
        """What the sideslip follows from besides `mean`, with the `gravity` in the specific side force [m/s2]."""
        return SideLoad(gravity, self.bend)


def alone(covariance: Array, index: int, sigma: float) -> Array:
    """Covariance with the standard deviation of one state reset and its correlations removed."""
    P = covariance.copy()
    P[index], P[:, index] = 0.0, 0.0
    P[index, index] = sigma * sigma
    return P


def forget_correlated(core: Core) -> Core:
    """State with the correlated error reset to its stationary distribution, as for another fix quality."""
    mean = core.mean.copy()
    mean[[G_E, G_N]] = 0.0
    return core._replace(mean=mean, covariance=alone(alone(core.covariance, G_E, 1.0), G_N, 1.0))


def at_fix(core: Core, fix: Fix, noise: FixNoise) -> Core:
    """State with the position and its uncertainty reset to those of the fix."""
    core, sigma = forget_correlated(core), sqrt(noise.correlated**2 + noise.white**2)
    mean = core.mean.copy()
    mean[X], mean[Y] = fix.x, fix.y
    return core._replace(mean=mean, covariance=alone(alone(core.covariance, X, sigma), Y, sigma))


def turned(core: Core, angle: float, sigma: float) -> Core:
    """State after the search: yaw corrected by `angle` [rad], with the uncertainty `sigma` [rad]."""
    mean = core.mean.copy()
    mean[PSI] += angle
    return core._replace(mean=mean, covariance=alone(core.covariance, PSI, sigma), search=None)


def accepted(core: Core, t: float) -> Core:
    """State after a position that passed the gate at `t` [s]."""
    if core.probation > 1:
        return core._replace(refused_position=0, probation=core.probation - 1)
    return core._replace(refused_position=0, probation=0, accepted_t=t)


def restarted(core: Core, fix: Fix, noise: FixNoise) -> Core:
    """State restarted at the fix after too many refusals."""
    return at_fix(core, fix, noise)._replace(refused_position=0, restarts=core.restarts + 1)
