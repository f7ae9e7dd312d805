"""Tests of the plugin parts, which the entry point registers on installation."""

import numpy as np
import pytest

import agrobot_mj
from agrobot_mj.core.geometry import wrap


@pytest.fixture(scope="module")
def log():
    """Return the log of 10 s on a circle with the guidance law and the compass of the plugin."""
    keys = {"plant.kind": "bicycle", "guidance.kind": "my_gains", "sensors.compass.enabled": True, "duration_s": 10}
    return agrobot_mj.run(agrobot_mj.load_scenario("circle", keys))


def test_law_stays_on_the_path(log):
    assert log.metrics["xte_abs_max"] < 0.2


def test_compass_has_bias_and_noise(log):
    pairs = zip(log.column("compass"), log.column("yaw"), strict=True)
    errors = np.degrees([wrap(reading - yaw) for reading, yaw in pairs])
    assert np.mean(errors) == pytest.approx(2.0, abs=0.15)
    assert np.std(errors) == pytest.approx(0.5, rel=0.2)


def test_metric_equals_sum_of_steering_changes(log):
    travel = np.abs(np.diff(log.column("steer"))).sum()
    assert log.metrics["steering_travel"] * 10 == pytest.approx(travel, rel=0.02)
