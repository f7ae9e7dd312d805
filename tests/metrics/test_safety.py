"""Consequences of a fault: time to the stop, distance from the path, and overspeed."""

import numpy as np
import pytest

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.metrics import RunView
from agrobot_mj.metrics.safety import Safety
from agrobot_mj.paths import Line


class Made:
    """Log of 400 ticks along a line to the east at 1.2 m/s, with a fault from tick 100 and a stop from tick 200."""

    def __init__(self, **changed):
        n = 400
        t, state = TICK_S * np.arange(n), np.where(np.arange(n) < 200, 2.0, 4.0)
        sound = {"t": t, "x": 1.2 * t, "y": np.zeros(n), "speed": np.full(n, 1.2), "speed_ref": np.full(n, 1.2)}
        self.columns = {**sound, "supervisor_state": state, "faults_active": (np.arange(n) >= 100) * 1.0, **changed}
        self.scenario = self
        self.path = Line(speed_m_s=1.2, ramp_s=0.0)

    def column(self, name):
        return self.columns[name]


def test_stop_time_is_measured_from_the_start_of_the_fault():
    found = Safety().evaluate(RunView(Made()))["safety"]
    assert found["stop_s"] == pytest.approx(100 * TICK_S)
    assert (found["offset_max"], found["off_s"], found["overspeed"]) == pytest.approx((0.0, 0.0, 1.0), abs=1e-9)


def test_stopping_distance_is_measured_from_the_start_of_the_fault():
    slowing = np.where(np.arange(400) < 200, 1.2, 0.0)
    assert Safety().evaluate(RunView(Made(speed=slowing)))["safety"]["way"] == pytest.approx(1.2 * 100 * TICK_S)


def test_final_speed_metric_is_the_magnitude_of_the_last_speed():
    slowing = np.linspace(-1.2, -0.3, 400)
    assert Safety().evaluate(RunView(Made(speed=slowing)))["safety"]["speed_end"] == pytest.approx(0.3)


def test_maximum_offset_is_zero_if_positions_after_the_fault_are_unknown():
    lost = np.where(np.arange(400) < 100, 0.0, np.nan)
    assert Safety().evaluate(RunView(Made(y=lost)))["safety"]["offset_max"] == 0.0


def test_safety_metrics_are_absent_without_a_fault_or_a_supervisor():
    assert Safety().evaluate(RunView(Made(faults_active=np.zeros(400)))) == {}
    made = Made()
    del made.columns["supervisor_state"]
    assert Safety().evaluate(RunView(made)) == {}


def test_stop_time_is_missing_without_a_stop():
    assert Safety().evaluate(RunView(Made(supervisor_state=np.full(400, 2.0))))["safety"]["stop_s"] is None


def test_time_off_the_path_counts_offsets_above_one_metre():
    away = -0.02 * np.maximum(np.arange(400) - 250, 0)
    found = Safety().evaluate(RunView(Made(y=away)))["safety"]
    assert found["offset_max"] == found["offset_end"] == pytest.approx(2.98)
    assert found["off_s"] == pytest.approx((400 - 301) * TICK_S, abs=TICK_S)


def test_overspeed_is_relative_to_the_maximum_recent_command():
    speed, command = np.full(400, 1.2), np.full(400, 1.2)
    command[150:] = 0.6
    assert Safety().evaluate(RunView(Made(speed=speed, speed_ref=command)))["safety"]["overspeed"] == pytest.approx(2.0)
    speed[189:] = 0.6
    assert Safety().evaluate(RunView(Made(speed=speed, speed_ref=command)))["safety"]["overspeed"] == pytest.approx(1.0)
    assert Safety().evaluate(RunView(Made(speed=-2.4 * speed)))["safety"]["overspeed"] == pytest.approx(2.4)
