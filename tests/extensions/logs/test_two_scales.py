"""Calibration of a steering sensor with different scales to the left and right: centre and both scales."""

from math import degrees

import numpy as np
import pyarrow as pa
import pytest
from field_logs import WHEELBASE_M, field_log, field_map, path, recorded

from agrobot_mj.extensions.logs.calibrate import calibrate
from agrobot_mj.extensions.logs.words import map_lines, sentences
from agrobot_mj.scenario.loading import load_scenario

UTILITY = load_scenario("straight_line", {"machine": "utility", "tractor.wheelbase_m": WHEELBASE_M})
CENTRE = 2040


def two_sided(left, right, positive=1.0):
    """Return a function from wheel angles [rad] to sensor counts with two scales [deg/count]."""

    def counts(wheel):
        angle = np.degrees(wheel)
        return CENTRE + positive * angle / np.where(angle > 0, left, right)

    return counts


LEFT_POSITIVE = pytest.param(0.085, 0.115, 1.0, marks=pytest.mark.slow)


@pytest.mark.parametrize(("left", "right", "positive"), [LEFT_POSITIVE, (0.12, 0.09, -1.0), (0.1, 0.1, 1.0)])
def test_steering_centre_and_both_scales_are_identified(left, right, positive):
    side = "left" if positive > 0 else "right"
    steer = {"offset": CENTRE + 13, "scale": 0.1, "positive": side}
    columns = field_log(path(duration=60.0, swing_deg=14.0), counts=two_sided(left, right, positive))
    found = calibrate([pa.table(columns)], field_map(columns, steer=steer), UTILITY)
    assert not found.found["steer.offset"].excludes(CENTRE)
    assert found.found["steer.offset"].half < 2.0, "13 counts of a wrong centre are told"
    assert not found.found["steer.scale"].excludes(left)
    assert not found.found["steer.scale_right"].excludes(right)
    assert found.two_scales == (left != right)
    if left != right:
        assert "scale_right = " in map_lines(found)
        assert any("has two scales" in line for line in sentences(found, UTILITY.tractor))


def test_map_with_two_scales_converts_counts_to_the_wheel_angle():
    driven = path(swing_deg=14.0)
    columns = field_log(driven, counts=two_sided(0.085, 0.115))
    steer = {"offset": CENTRE, "scale": 0.085, "scale_right": 0.115}
    t, angle = recorded(columns, steer=steer).steer
    assert np.degrees(angle) == pytest.approx(degrees(1.0) * np.interp(t, driven[0], driven[2]), abs=0.6)
    assert recorded(columns, readings=True, steer=steer).steer.value == pytest.approx(columns["steer"])
