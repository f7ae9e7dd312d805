"""Columns under a map become series in SI units, and what is not recorded is derived."""

from math import pi, sin

import numpy as np
import pyarrow as pa
import pytest
from pydantic import ValidationError

from agrobot_mj.fieldlogs.maps import INSTEAD, LogMap, PositionColumns, lacking
from agrobot_mj.fieldlogs.recording import read_recording
from agrobot_mj.fieldlogs.series import COURSE_S

T = np.arange(0.0, 30.0, 0.05)
YAW_RATE, SPEED = 0.2, 1.5
YAW = 0.4 + YAW_RATE * T
ARC = SPEED / YAW_RATE * np.column_stack((np.sin(YAW) - sin(0.4), np.cos(0.4) - np.cos(YAW)))
COLUMNS = {"t": T, "steer": np.degrees(0.2 * np.sin(T)), "speed": np.full(len(T), SPEED)}
MAP = {"time": {"column": "t"}, "steer": {"column": "steer"}, "speed": {"column": "speed"}}
POSITION = {"position": {"east": "x", "north": "y"}}


def read(columns, **tables):
    return read_recording(pa.table(COLUMNS | columns), LogMap.model_validate(MAP | tables), 2.0)


@pytest.mark.parametrize("convention", ["enu", "compass"])
def test_a_heading_counts_from_east_and_gives_the_yaw_rate(convention):
    told = np.degrees(YAW) if convention == "enu" else 90.0 - np.degrees(YAW)
    found = read({"h": told % 360.0}, heading={"column": "h", "convention": convention})
    apart = found.heading.value - YAW
    assert np.ptp(apart) < 1e-9
    assert abs((apart[0] + pi) % (2 * pi) - pi) < 1e-9
    assert found.yaw_rate_source == "heading"
    assert found.yaw_rate.value == pytest.approx(YAW_RATE, abs=1e-6)


@pytest.mark.parametrize("rate_hz", [20, 10])
def test_the_course_of_positions_gives_the_yaw_rate(rate_hz):
    rows = np.arange(len(T)) % (20 // rate_hz) == 0
    x, y = np.where(rows, ARC.T, np.nan)
    found = read({"x": x, "y": y}, **POSITION)
    assert found.yaw_rate_source == "course"
    assert found.yaw_rate.value == pytest.approx(YAW_RATE, rel=0.02)
    assert found.yaw_rate.value[40:-40] == pytest.approx(YAW_RATE, rel=0.005), "a cubic falls short of a sine"
    assert found.yaw_rate.t[0] <= T[0] + COURSE_S


def test_a_slow_course_counts_whole():
    slow = 0.4 / SPEED
    columns = {"x": slow * ARC[:, 0], "y": slow * ARC[:, 1], "speed": np.full(len(T), 0.4)}
    found = read(columns, **POSITION)
    assert found.yaw_rate.value[40:-40] == pytest.approx(YAW_RATE, rel=0.005)


def test_a_course_is_smoothed_over_its_own_time():
    """A cubic over 2 s at 20 Hz takes noise out of a second derivative."""
    noise = 0.002 * np.random.default_rng(1).standard_normal((len(T), 2))
    found = read(dict(zip("xy", (ARC + noise).T, strict=True)), **POSITION)
    error = np.abs(found.yaw_rate.value - YAW_RATE)[40:-40]
    assert 1e-4 < np.sqrt(np.mean(error**2)) < 0.02


def test_the_averaging_of_a_sensor_is_undone():
    """The mean of a sine of w over a time a falls short by sin(w a / 2) / (w a / 2)."""
    w, a = 2.0, 0.4
    angle = 0.2 * np.sin(w * T)
    averaged = angle * sin(w * a / 2) / (w * a / 2)
    columns, heading = {"steer": np.degrees(averaged), "h": np.degrees(YAW)}, {"column": "h"}
    found = read(columns, heading=heading)
    sharp = read(columns, heading=heading, steer={"column": "steer", "averaged_s": a})
    assert np.abs(found.steer.value - angle).max() > 0.005
    assert sharp.steer.value[1:-1] == pytest.approx(angle[1:-1], abs=5e-4)


def test_a_part_leaves_out_what_it_has_too_few_values_of():
    h = np.where(T < 10.1, np.degrees(YAW), np.nan)
    found = read({"h": h, "x": ARC[:, 0], "y": ARC[:, 1]}, heading={"column": "h"}, **POSITION)
    assert found.between(0.0, 9.0).heading is not None
    later = found.between(10.0, 20.0)
    assert later.heading is None
    assert (len(later.position.t), later.start, later.end) == (201, 10.0, 20.0)


def test_one_coordinate_is_no_position():
    for key in ("east", "north", "latitude", "longitude"):
        with pytest.raises(ValidationError, match="name latitude and longitude, or east and north"):
            PositionColumns.model_validate({key: "x"})


def test_one_column_is_one_quantity():
    with pytest.raises(ValidationError, match=r"yaw_rate.column: 'steer' is steer.column already; name another column"):
        LogMap.model_validate(MAP | {"steer": {"column": "steer"}, "yaw_rate": {"column": "steer"}})


@pytest.mark.parametrize("name", INSTEAD)
def test_what_may_stand_for_a_wheel_angle_is_told(name):
    names = ["t", "speed", "heading", name]
    told = f"it has no wheel angle; [steer] of a map may name {name}, {INSTEAD[name]}"
    assert lacking(["time", "speed", "heading"], names) == told
    assert lacking(["time", "speed", "steer"], names) == "it has no yaw rate, heading or position to compare with"
    assert lacking(["time", "speed", "steer", "heading"], names) == ""
