"""Content of one tick for the topics, from a simulation under way or from the table of a finished run.

The same numbers in both, so that a recording holds what a live subscriber would have received.
"""

from collections import namedtuple
from collections.abc import Iterator
from math import nan

import numpy as np
import pyarrow as pa

from agrobot_mj.core.signals import Quality
from agrobot_mj.simulation.stepping import Simulation

TickSample = namedtuple(
    "TickSample",
    "t gnss_x gnss_y gnss_quality imu_roll imu_pitch gyro steer_measured wheel_speed "
    "rear_x_hat rear_y_hat yaw_hat speed_hat yaw_rate_hat p_xx p_xy p_yy p_yaw "
    "rear_x rear_y z yaw pitch roll speed lateral_speed yaw_rate "
    "imu_force_x imu_force_y imu_force_z cmd_speed cmd_yaw_rate cmd_age",
    defaults=(nan, nan, nan, nan, nan, nan),
)
"""Signals of one tick, named as the columns of a log and in their units; NaN for those that a run does not have."""


def sample_of(sim: Simulation) -> TickSample:
    """The present tick of a simulation; the sensors are read if they have not been."""
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
    quality = TickSample._fields.index("gnss_quality")
    columns[quality] = np.nan_to_num(columns[quality], nan=Quality.NONE)  # of a run that diverged at once
    return (TickSample(*row) for row in np.column_stack(columns).astype(float).tolist())
