"""Tyre scrub: fraction of the kinematic yaw rate that a plant loses in slow bends."""

from math import radians

import numpy as np

from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.driving import drive
from agrobot_mj.extensions.logs.series import TimeSeries
from agrobot_mj.scenario.schema import Scenario

SPEED_M_S, ANGLE_DEG = 1.0, 8.0
"""Speed [m/s] and wheel angle [deg] of the slow bend, in which the centrifugal force is negligible."""
SETTLED_S, END_S = 3.0, 4.0  # Start and end of the evaluated part of the bend [s]


def scrub(scenario: Scenario) -> float:
    """Return the mean fraction of the kinematic yaw rate that the tyres lose in slow bends to both sides on level
    ground [-]."""
    lost, scenario = [], scenario.changed({"terrain.kind": "flat"})
    for angle in (radians(ANGLE_DEG), -radians(ANGLE_DEG)):
        driven = drive(scenario, _bend(angle), (0.0, 0.0, 0.0))
        steady = driven.t > SETTLED_S
        kinematic = driven.speed * np.tan(driven.steer) / scenario.tractor.wheelbase_m
        lost.append(1.0 - float(driven.yaw_rate[steady].mean() / kinematic[steady].mean()))
    return max(float(np.mean(lost)), 0.0)


def _bend(angle: float) -> FieldRecording:
    t = np.array([0.0, 0.5, 1.0, END_S])
    speed, steer = TimeSeries(t, np.full(4, SPEED_M_S)), TimeSeries(t, np.full(4, angle))
    none = dict.fromkeys(("voltage", "yaw_rate", "heading", "position"))
    return FieldRecording(
        name="bend",
        start=0.0,
        end=END_S,
        speed=speed,
        wheel_speed=False,
        antenna_speed=False,
        steer=steer,
        yaw_rate_source="none",
        notes=(),
        arm=(0.0, 0.0, 0.0),
        inputs={},
        signed=True,
        **none,
    )
