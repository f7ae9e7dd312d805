"""The record of a run: one row a tick.

`Rows` is filled while the run goes; `Log` is what `run` returns. Units are SI and radians, as in `signals`; a value
that does not exist (no fix, no network) is NaN here and null in the table.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.plants.scene import Scene
from agrobot_mj.scenario.schema import Scenario

COLUMNS = (
    *("t", "x_ref", "y_ref", "z_ref", "yaw_ref", "curvature_ref"),
    *("x", "y", "z", "yaw", "pitch", "roll", "speed", "lateral_speed", "yaw_rate", "rear_x", "rear_y"),
    *("x_hat", "y_hat", "yaw_hat", "speed_hat", "yaw_rate_hat", "steer_bias_hat", "rear_x_hat", "rear_y_hat"),
    *("p_xx", "p_xy", "p_yy", "p_yaw", "position_nees", "position_nis", "gnss_x", "gnss_y", "gnss_quality"),
    "faults_active",
    *("e_longitudinal", "e_lateral", "speed_ref", "yaw_rate_ref", "e_yaw_rate", "tau_c", "tau_n", "q"),
    *("steer_ref", "steer", "steer_measured", "steer_saturated", "valve_voltage"),
    *("pedal_ref", "pedal", "pedal_measured", "pedal_voltage"),
    *("valve_flow", "steer_pressure", "drive_torque"),
)
"""Columns of every plant, in the order of `simulate.row`; the last three are `RunningPlant.actuation`."""
WHEEL_COLUMNS = tuple(
    f"{quantity}_{wheel}"
    for quantity in ("load", "slip_angle", "slip_ratio", "fx", "fy", "friction_use")
    for wheel in WHEELS
)
"""Further columns of a plant with wheels, in the order of `RunningPlant.wheels`."""
NOTHING = np.empty(0)


class Rows:
    """Room for the whole run, filled row by row."""

    def __init__(self, ticks: int, wheels: int, bodies: int, extra: tuple[str, ...] = ()) -> None:
        """`extra` are the columns of the yaw controller."""
        self.columns = COLUMNS + WHEEL_COLUMNS[:wheels] + extra
        self.values = np.full((ticks, len(self.columns)), np.nan)
        self.poses = np.zeros((ticks, bodies, 7))
        self.filled = 0

    def append(self, row: tuple[float, ...], wheels: Array, poses: Array, extra: Array = NOTHING) -> None:
        """One tick: the common columns, the wheels' report, the bodies' poses and the controller's report."""
        k = self.filled
        self.values[k, : len(COLUMNS)] = row
        self.values[k, len(COLUMNS) : len(COLUMNS) + wheels.size] = wheels
        self.values[k, len(COLUMNS) + wheels.size :] = extra
        self.poses[k] = poses
        self.filled = k + 1

    def column(self, name: str, first: int = 0) -> Array:
        """Column `name` from row `first` to the last row filled, shape (n,)."""
        return self.values[first : self.filled, self.columns.index(name)]


@dataclass(frozen=True)
class Log:
    """A finished run."""

    scenario: Scenario
    rows: Rows
    scene: Scene
    outcome: str
    """One of `outcomes.Outcome`."""
    wall_s: float
    """[s]."""
    metrics: dict[str, Any] = field(default_factory=dict)
    """See `metrics.metrics`."""

    @cached_property
    def signals(self) -> pa.Table:
        """One row a tick, float64, null where a value does not exist."""
        arrays = [pa.array(self.column(name).copy(), from_pandas=True) for name in self.rows.columns]
        return pa.table(arrays, names=list(self.rows.columns))

    @property
    def poses(self) -> Array:
        """Pose of every body of the scene at each tick, shape (ticks, bodies, 7): x y z, quaternion w x y z."""
        return self.rows.poses[: self.rows.filled]

    def column(self, name: str) -> Array:
        """Column `name`, shape (ticks,); raises ValueError for an unknown one."""
        return self.rows.column(name)
