"""Conversion of log columns by a map to series in SI units, and derived quantities."""

from math import pi, sin

import numpy as np
import pyarrow as pa
import pytest
from pydantic import ValidationError

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.maps import INSTEAD, LogMap, PositionColumns, lacking
from agrobot_mj.extensions.logs.pieces import pieces
from agrobot_mj.extensions.logs.recording import read_recording
from agrobot_mj.extensions.logs.series import COURSE_S, lone

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
def test_heading_is_converted_to_yaw_and_differentiated_to_yaw_rate(convention):
    told = np.degrees(YAW) if convention == "enu" else 90.0 - np.degrees(YAW)
    found = read({"h": told % 360.0}, heading={"column": "h", "convention": convention})
    apart = found.heading.value - YAW
    assert np.ptp(apart) < 1e-9
    assert abs((apart[0] + pi) % (2 * pi) - pi) < 1e-9
    assert found.yaw_rate_source == "heading"
    assert found.yaw_rate.value == pytest.approx(YAW_RATE, abs=1e-6)


@pytest.mark.parametrize(
    ("rows", "note"),
    [
        (np.arange(len(T))[::-1], "the rows are in reverse order of time"),
        (np.sort(np.r_[np.arange(len(T)), 100:130]), "30 rows with the time of another row are omitted"),
    ],
)
def test_rows_in_another_order_give_the_same_recording(rows, note):
    columns = COLUMNS | {"h": np.degrees(YAW)}
    clean, found = (
        read({name: each[k] for name, each in columns.items()}, heading={"column": "h", "convention": "enu"})
        for k in (np.arange(len(T)), rows)
    )
    assert found.notes == (note,)
    for part in ("steer", "heading", "yaw_rate"):
        before, after = getattr(clean, part), getattr(found, part)
        assert after.t == pytest.approx(before.t)
        assert after.value == pytest.approx(before.value)


@pytest.mark.parametrize(("step_s", "decrease"), [(-10.0, "9.95"), (-3600.0, "3.6e+03"), (-72e3, "7.2e+04")])
def test_rows_after_a_decrease_of_time_are_a_new_segment(step_s, decrease):
    """Restart of a recording, end of daylight-saving time, and a clock that starts again at midnight."""
    t = T + step_s * (T > 15.01)
    found = pieces([read({"t": t, "x": ARC[:, 0], "y": ARC[:, 1]}, **POSITION)])
    assert [each.end - each.start for each in found.kept] == pytest.approx([15.0, 14.9])
    assert f"log: the time decreases by {decrease} s; the following rows are a new segment" in found.notes
    assert found.kept[1].position.value[-1] == pytest.approx(ARC[-1])


def test_rows_in_random_order_are_rejected():
    with pytest.raises(FieldLogError, match=r"decreases at row .*; sort the rows by time"):
        read({"t": np.random.default_rng(1).permutation(T), "x": ARC[:, 0], "y": ARC[:, 1]}, **POSITION)


@pytest.mark.parametrize("rate_hz", [20, 10])
def test_yaw_rate_is_derived_from_the_course_of_positions(rate_hz):
    rows = np.arange(len(T)) % (20 // rate_hz) == 0
    x, y = np.where(rows, ARC.T, np.nan)
    found = read({"x": x, "y": y}, **POSITION)
    assert found.yaw_rate_source == "course"
    assert found.yaw_rate.value == pytest.approx(YAW_RATE, rel=0.02)
    assert found.yaw_rate.value[40:-40] == pytest.approx(YAW_RATE, rel=0.005), "a cubic falls short of a sine"
    assert found.yaw_rate.t[0] <= T[0] + COURSE_S


def test_derived_yaw_rate_is_not_attenuated_at_low_speed():
    slow = 0.4 / SPEED
    columns = {"x": slow * ARC[:, 0], "y": slow * ARC[:, 1], "speed": np.full(len(T), 0.4)}
    found = read(columns, **POSITION)
    assert found.yaw_rate.value[40:-40] == pytest.approx(YAW_RATE, rel=0.005)


def test_position_noise_is_smoothed_when_deriving_the_yaw_rate():
    """A cubic over 2 s at 20 Hz reduces the noise of the second derivative."""
    noise = 0.002 * np.random.default_rng(1).standard_normal((len(T), 2))
    found = read(dict(zip("xy", (ARC + noise).T, strict=True)), **POSITION)
    error = np.abs(found.yaw_rate.value - YAW_RATE)[40:-40]
    assert 1e-4 < np.sqrt(np.mean(error**2)) < 0.02


def test_averaging_by_the_steering_sensor_is_compensated():
    """Averaging a sine of frequency w over a time a multiplies its amplitude by sin(w a / 2) / (w a / 2)."""
    w, a = 2.0, 0.4
    angle = 0.2 * np.sin(w * T)
    averaged = angle * sin(w * a / 2) / (w * a / 2)
    columns, heading = {"steer": np.degrees(averaged), "h": np.degrees(YAW)}, {"column": "h"}
    found = read(columns, heading=heading)
    sharp = read(columns, heading=heading, steer={"column": "steer", "averaged_s": a})
    assert np.abs(found.steer.value - angle).max() > 0.005
    assert sharp.steer.value[1:-1] == pytest.approx(angle[1:-1], abs=5e-4)


def test_segment_omits_channels_with_too_few_values():
    h = np.where(T < 10.1, np.degrees(YAW), np.nan)
    found = read({"h": h, "x": ARC[:, 0], "y": ARC[:, 1]}, heading={"column": "h"}, **POSITION)
    assert found.between(0.0, 9.0).heading is not None
    later = found.between(10.0, 20.0)
    assert later.heading is None
    assert (len(later.position.t), later.start, later.end) == (201, 10.0, 20.0)


def test_position_map_with_a_single_coordinate_is_rejected():
    for key in ("east", "north", "latitude", "longitude"):
        with pytest.raises(ValidationError, match="specify either latitude and longitude, or east and north"):
            PositionColumns.model_validate({key: "x"})


def test_column_mapped_to_two_quantities_is_rejected():
    with pytest.raises(
        ValidationError, match=r"yaw_rate.column: 'steer' is already used for steer.column; specify another column"
    ):
        LogMap.model_validate(MAP | {"steer": {"column": "steer"}, "yaw_rate": {"column": "steer"}})


@pytest.mark.parametrize("name", INSTEAD)
def test_possible_wheel_angle_columns_are_suggested(name):
    names = ["t", "speed", "heading", name]
    told = f"the log has no wheel angle; [steer] of a map can use column {name}, {INSTEAD[name]}"
    assert lacking(["time", "speed", "heading"], names) == told
    assert lacking(["time", "speed", "steer"], names) == "the log has no yaw rate, heading or position to compare with"
    assert lacking(["time", "speed", "steer", "heading"], names) == ""


GLITCHES = np.array([40, 131, 260, 411, 540])


@pytest.mark.parametrize("held", [1, 2, 4])
@pytest.mark.parametrize("off", [3.0, -0.4])
def test_isolated_outliers_of_a_signal_are_detected(held, off):
    """The signal has noise, repeats each value for some rows, and has a row without a value."""
    random = np.random.default_rng(8)
    values = 0.2 * np.sin(T) + 0.005 * random.standard_normal(len(T))
    values[GLITCHES] += off
    rows = np.repeat(values, held)
    rows[held * 300] = np.nan
    assert (
        np.flatnonzero(lone(np.arange(len(rows)) * 0.05, rows))
        == np.flatnonzero(np.repeat(np.isin(np.arange(len(T)), GLITCHES), held))
    ).all()


@pytest.mark.parametrize(
    "values",
    [
        np.random.default_rng(9).standard_normal(len(T)),
        np.round(20 * np.sin(T)),
        np.where(np.abs(T - 10.0) < 0.2, np.cos(2.5 * np.pi * (T - 10.0)), 0.0),
        np.where(T > 12.0, 1.0, 0.0),
        np.interp(T, [0, 10, 10.6, 11.2, 30], [0, 0, 30, 0, 0]),
        np.where(T[7] == T, 3.0, 0.0)[:8],
        np.full(100, np.nan),
    ],
    ids=["noise", "steps of a sensor", "quick steering", "a step", "lock and back", "at the end", "nothing"],
)
def test_fast_feasible_motion_is_not_an_outlier(values):
    assert not lone(T[: len(values)], values).any()


@pytest.mark.parametrize("zero", [0.0, -np.pi])
def test_heading_in_radians_mapped_as_degrees_is_detected_by_wrapping(zero):
    turning = (YAW - zero) % (2 * pi) + zero
    assert np.ptp(turning) > 6.0
    with pytest.raises(FieldLogError, match=r"'h' wraps by 2 pi, which indicates radians; set heading.unit"):
        read({"h": turning}, heading={"column": "h"})
    read({"h": np.degrees(turning)}, heading={"column": "h"})
    read({"h": turning}, heading={"column": "h", "unit": "rad"})


def test_outliers_are_omitted_and_reported():
    """Wheel angle, speed, gyro and a wrapping heading each have outliers."""
    columns = COLUMNS | {"g": np.full(len(T), YAW_RATE), "h": np.degrees(YAW) % 360.0}
    columns["g"] += 0.001 * np.random.default_rng(2).standard_normal(len(T))
    columns["speed"] = SPEED + 0.01 * np.sin(T)
    tables = {"yaw_rate": {"column": "g", "unit": "rad/s"}, "heading": {"column": "h", "convention": "enu"}}
    clean = read(columns, **tables)
    assert clean.notes == ()
    for name, off in (("steer", 90.0), ("speed", 30.0), ("g", 3.0), ("h", 180.0)):
        columns[name] = columns[name].copy()
        columns[name][GLITCHES] += off
    found = read(columns, **tables)
    told = [f"5 values of '{name}' far from their neighbours are omitted" for name in ("steer", "speed", "h", "g")]
    assert found.notes == tuple(told)
    for part in ("steer", "speed", "yaw_rate", "heading"):
        before, after = getattr(clean, part), getattr(found, part)
        assert len(after.t) == len(before.t) - 5
        assert after.value == pytest.approx(np.delete(before.value, GLITCHES))


def test_valve_pulses_are_not_outliers():
    volts = np.full(len(T), 6.0)
    volts[GLITCHES] = 12.0
    found = read({"volts": volts, "g": 0 * T}, valve={"column": "volts"}, yaw_rate={"column": "g", "unit": "rad/s"})
    assert (found.voltage.value == volts).all()
