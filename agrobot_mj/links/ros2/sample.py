"""What one tick has to tell, from a simulation under way or from the table of a finished run.

The same numbers in both, so that a recording holds what a live subscriber would have received.
"""

from collections.abc import Iterator
from math import nan
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import TICK_S, Quality
from agrobot_mj.simulation.stepping import Simulation


class TickSample(NamedTuple):
    """Signals of one tick, named as the columns of a log; NaN for those that a run does not have."""

    t: float
    """Time since the start [s]."""
    gnss_x: float
    """Solution of the antenna, east [m]."""
    gnss_y: float
    """Solution of the antenna, north [m]."""
    gnss_quality: float
    """One of `Quality`."""
    imu_roll: float
    """Left side up positive [rad]."""
    imu_pitch: float
    """Nose down positive [rad]."""
    gyro: float
    """Yaw rate, left positive [rad/s]."""
    steer_measured: float
    """Front-wheel angle, left positive [rad]."""
    wheel_speed: float
    """Driven wheels, forward positive [m/s]."""
    rear_x_hat: float
    """Estimated R, east [m]."""
    rear_y_hat: float
    """Estimated R, north [m]."""
    yaw_hat: float
    """Estimated heading [rad]."""
    speed_hat: float
    """Estimated speed [m/s]."""
    yaw_rate_hat: float
    """Estimated yaw rate [rad/s]."""
    p_xx: float
    """Estimated variance, east [m2]."""
    p_xy: float
    """Estimated covariance, east and north [m2]."""
    p_yy: float
    """Estimated variance, north [m2]."""
    p_yaw: float
    """Estimated variance of the heading [rad2]."""
    rear_x: float
    """True R, east [m]."""
    rear_y: float
    """True R, north [m]."""
    z: float
    """True CG, up [m]."""
    yaw: float
    """True heading [rad]."""
    pitch: float
    """True pitch, nose down positive [rad]."""
    roll: float
    """True roll, left side up positive [rad]."""
    speed: float
    """True speed of the CG [m/s]."""
    lateral_speed: float
    """True lateral speed of the CG [m/s]."""
    yaw_rate: float
    """True yaw rate [rad/s]."""
    imu_force_x: float = nan
    """Specific force at the inertial unit, forward [m/s2]."""
    imu_force_y: float = nan
    """Specific force at the inertial unit, to the left [m/s2]."""
    imu_force_z: float = nan
    """Specific force at the inertial unit, up [m/s2]."""
    cmd_speed: float = nan
    """Speed asked for on /cmd_vel [m/s]."""
    cmd_yaw_rate: float = nan
    """Yaw rate asked for on /cmd_vel [rad/s]."""
    cmd_age: float = nan
    """Age of that request [s]."""


def sample_of(sim: Simulation) -> TickSample:
    """The present tick of a simulation, which is sensed now where it has not been."""
    m, e, truth = sim.measurement, sim.estimate, sim.truth
    fix = (m.fix.x, m.fix.y) if m.fix else (nan, nan)
    p = e.covariance
    return TickSample(
        *(truth.t, *fix, float(m.quality if m.fix else Quality.NONE), m.roll, m.pitch, m.gyro, m.steer, m.wheel_speed),
        *(e.rear_x, e.rear_y, e.yaw, e.speed, e.yaw_rate),
        *(float(p[0, 0]), float(p[0, 1]), float(p[1, 1]), float(p[2, 2])),
        *(truth.rear_x, truth.rear_y, truth.z, truth.yaw, truth.pitch, truth.roll),
        *(truth.speed, truth.lateral_speed, truth.yaw_rate),
        *m.readings["imu"][2:],
    )


def samples_of(signals: pa.Table) -> Iterator[TickSample]:
    """Every tick of `signals.parquet`."""
    known = set(signals.column_names)
    columns = [
        signals[name].to_numpy() if name in known else np.full(len(signals), np.nan) for name in TickSample._fields
    ]
    columns[QUALITY] = np.nan_to_num(columns[QUALITY], nan=Quality.NONE)  # of a run that diverged at once
    return (TickSample(*row) for row in np.column_stack(columns).astype(float).tolist())


QUALITY = TickSample._fields.index("gnss_quality")


class Heading:
    """Heading of an inertial unit: its gyro, integrated from the true heading at the start; NaN without a gyro."""

    def __init__(self) -> None:
        self.yaw = nan

    def follow(self, sample: TickSample) -> float:
        """The heading in the next tick [rad]."""
        begun = self.yaw == self.yaw
        self.yaw = wrap(self.yaw + sample.gyro * TICK_S) if begun else sample.yaw + 0.0 * sample.gyro
        return self.yaw
