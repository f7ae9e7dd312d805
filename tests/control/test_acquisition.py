"""A tractor that starts beside a level straight line comes onto it, without a weave that lasts."""

import numpy as np
import pytest

from agrobot_mj import load_scenario
from agrobot_mj.simulation.run import run

SENSORS = {"estimator.kind": "ekf_full", "sensors.gyro.enabled": True, "sensors.wheel_speed.enabled": True}
STARTS = [(0.5, 0.0, 1.2), (3.0, 0.0, 2.0), (6.0, 0.0, 2.0), (-1.5, 45.0, 4.0), (3.0, 90.0, 1.2)]
"""Offset to the left [m], heading from the line [deg], speed [m/s]."""


def offsets(law, start):
    """Distance from the line on the side of the start [m], over the run, and its ticks in a second."""
    offset, heading, speed = start
    changes = {"path.start_offset_m": offset, "path.start_heading_deg": heading, "path.speed_m_s": speed}
    more = {"plant.kind": "bicycle", "guidance.kind": law, "supervisor.enabled": False, "duration_s": 45.0}
    log = run(load_scenario("straight_line", {**changes, **more, **SENSORS}))
    return (log.column("y") - log.column("y_ref")) * np.sign(offset)


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("law", ["lqr", "stanley", "pure_pursuit"])
def test_a_line_is_acquired_and_kept(law, start):
    y = offsets(law, start)
    assert abs(y[-200:]).max() < (0.06 if start[2] < 4.0 else 0.2)


@pytest.mark.parametrize("start", STARTS)
def test_the_integral_of_the_lqr_does_not_wind_up_on_the_way(start):
    assert -offsets("lqr", start).min() < 0.12
