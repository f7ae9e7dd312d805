"""Health of a log without a fit: position noise, bursts, steering centre over time, and antenna position."""

from math import radians

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pytest
from field_logs import WHEELBASE_M, field_log, field_map, motion, path, recorded

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.health import health_lines
from agrobot_mj.extensions.logs.replay.result import replay
from agrobot_mj.extensions.logs.steering import RoughSteering, SteeringCentre, centres_differ, standard_error
from agrobot_mj.extensions.logs.words import doubts
from agrobot_mj.scenario.loading import load_scenario

DRIVEN = path(duration=100.0, swing_deg=12.0)
SCALE = 0.15
BICYCLE = load_scenario("straight_line", {"plant.kind": "bicycle", "tractor.wheelbase_m": WHEELBASE_M})


def counts_about(centre):
    """Return a function that converts wheel angles to potentiometer counts with the given centre."""
    return lambda wheel: centre + np.degrees(wheel) / SCALE


def lines_of(columns, offset=432, **more):
    """Return the sentences about a log whose map has the steering centre `offset`."""
    return health_lines([pa.table(columns)], field_map(columns, steer={"offset": offset, "scale": SCALE}, **more))


def test_fault_free_log_reports_only_position_scatter_and_steering_centres():
    scatter, centres = lines_of(field_log(DRIVEN, counts=counts_about(432)))
    assert float(scatter.split("scatter by ")[1].split()[0]) == pytest.approx(1.0, abs=0.1)
    assert centres.startswith("log: the steering explains 100 % of the yaw rate; steering centre: ")
    assert [float(part.split()[0]) for part in centres.split("centre: ")[1].split("), ")] == pytest.approx(
        [432] * 6, abs=0.5
    )


def test_numbers_too_large_for_a_square_are_missing_values():
    columns = field_log(DRIVEN, counts=counts_about(432))
    missing = np.abs(columns["t"] - 50.0) < 0.5
    expected, found = (columns | {"steer": np.where(missing, value, columns["steer"])} for value in (np.nan, 1e200))
    assert lines_of(found) == lines_of(expected)


def test_log_with_few_positions_gives_no_antenna_position():
    columns = field_log(DRIVEN, counts=counts_about(432))
    for name in ("east", "north"):
        columns[name] = np.where(columns["t"] % 20 < 0.01, columns[name], np.nan)
    assert not any("antenna" in line for line in lines_of(columns))


def test_headings_that_turn_too_fast_in_a_wrong_time_unit_are_rejected():
    columns = field_log(DRIVEN)
    columns["heading"] = columns["heading"] + np.where(columns["t"] > 50, 120, 0)
    columns["t"] = 1e-3 * columns["t"]
    with pytest.raises(
        FieldLogError, match=r"values of 'heading' imply an impossible yaw rate; check heading.unit and"
    ):
        recorded(columns)


@pytest.mark.parametrize("heading", [True, False])
@pytest.mark.parametrize("scale", [0.1, 0.15])
def test_steering_centre_that_differs_from_the_map_is_reported(heading, scale):
    columns = field_log(DRIVEN, counts=counts_about(370), heading=heading)
    steer = {"offset": 432, "scale": scale}
    told = health_lines([pa.table(columns)], field_map(columns, steer=steer))[-1]
    assert ", but the map has 432: the sensor has moved" in told
    assert float(told.split("in this log is ")[1].split(",")[0]) == pytest.approx(370, abs=1.0)


def test_steering_centre_that_moves_within_a_log_is_reported():
    columns = field_log(DRIVEN, counts=counts_about(432))
    columns["steer"] += np.where(columns["t"] > 50, 20, 0)
    told = lines_of(columns)[-1]
    assert told.endswith("within this log; check whether the sensor is loose")
    assert float(told.split("moves by ")[1].split()[0]) == pytest.approx(20, abs=2)


def test_centres_are_correct_for_bends_to_one_side_in_each_half():
    """Another wheelbase than that of the first regression makes the relation to the sensor value nonlinear."""
    t = DRIVEN[0]
    wheel = np.where(t < 50, 1, -1) * radians(40) * (0.55 + 0.45 * np.sin(t / 1.8))
    _, centres = lines_of(field_log(motion(t, np.ones(len(t)), wheel, wheelbase=1.0), counts=counts_about(432)))
    values = [float(part.split()[0]) for part in centres.split("centre: ")[1].split("), ")]
    assert values == pytest.approx([432] * 6, abs=1.0)


def test_slip_of_the_steering_sensor_is_not_taken_for_two_scales():
    t, u, wheel, *_ = path(duration=100.0, swing_deg=20.0)
    wheel = np.where(t < 50, np.interp(t, [0, 3, 24, 27, 47, 50], np.radians([0, 26, 26, -26, -26, 0])), wheel)
    columns = field_log(motion(t, u, wheel), counts=counts_about(432))
    columns["steer"] += np.where(columns["t"] > 55, 20, 0)
    told = lines_of(columns)[-1]
    assert float(told.split("moves by ")[1].split()[0]) == pytest.approx(20, abs=2)


def test_scatter_of_the_steering_centre_is_not_reported_as_a_movement():
    """For positions without a heading, the centres of the log parts differ only by noise."""
    columns = field_log(DRIVEN, counts=counts_about(432), heading=False, noise_m=0.08, every=10)
    (told,) = [line for line in lines_of(columns) if "steering centre: " in line]
    centres = [float(part.split()[0]) for part in told.split("centre: ")[1].split("), ")]
    assert SCALE * np.ptp(centres) > 1.0
    assert not any("moves by" in line for line in lines_of(columns))


@pytest.mark.parametrize(("error", "expected"), [(0.5, True), (4.0, False), (standard_error([432.0]), False)])
def test_change_of_centre_below_three_standard_errors_is_not_reported(error, expected):
    line = RoughSteering(centre=432.0, scale=np.radians(SCALE), age=0.0, explained=1.0)
    assert centres_differ([SteeringCentre(432.0, error), SteeringCentre(452.0, error)], line) == expected


def test_steering_centre_that_moves_between_two_logs_is_reported():
    logs = [pa.table(field_log(DRIVEN, counts=counts_about(centre), seed=centre)) for centre in (432, 452)]
    log_map = field_map(field_log(DRIVEN), steer={"scale": SCALE})
    told = health_lines(logs, log_map)[-1]
    assert told.endswith("the sensor has moved; evaluate each log separately")
    before, after = (float(told.split(word)[1].split()[0]) for word in ("centre is ", " and "))
    assert (before, after) == (pytest.approx(432, abs=1), pytest.approx(452, abs=1))
    assert not any("has moved" in line for line in health_lines([logs[0], logs[0]], log_map))


@pytest.mark.parametrize("reverse", [[], [(12.0, 30.0)]])
def test_replay_reports_the_offset_of_the_steering_centre(reverse):
    columns = field_log(path(duration=40.0, reverse=reverse), counts=counts_about(432), signed=True)
    steer = {"offset": 412, "scale": SCALE}
    found = replay([pa.table(columns)], field_map(columns, steer=steer), BICYCLE)
    (told,) = [line for line in doubts(found, BICYCLE.tractor) if "whether the steering sensor has moved" in line]
    assert float(told.split("wheels are probably ")[1].split()[0]) == pytest.approx(20 * SCALE, abs=0.3)
    assert "deg further to the right than in the map" in told
    right = replay([pa.table(columns)], field_map(columns, steer=steer | {"offset": 432}), BICYCLE)
    assert not any("whether the steering sensor has moved" in line for line in doubts(right, BICYCLE.tractor))


def test_steering_centre_of_a_sensor_with_two_scales_is_identified():
    columns = field_log(DRIVEN, counts=lambda wheel: 2040 + np.degrees(wheel) / np.where(wheel > 0, 0.085, 0.115))
    assert not any("but the map has" in line for line in lines_of(columns, 2040))
    assert any("the steering centre in this log is 204" in line for line in lines_of(columns, 2060))


def test_steering_centre_is_reported_for_segments_too_short_for_a_fit():
    columns = field_log(DRIVEN, counts=counts_about(370))
    kept = columns["t"] % 8.0 < 2.0
    lines = lines_of({name: values[kept] for name, values in columns.items()})
    assert "log: recorded in 13 bursts of 2.0 s, one every 8.0 s" in lines[0]
    assert "the steering centre in this log is 370" in lines[-1]


def test_log_health_reports_antenna_offset_ahead_of_the_axle():
    columns = field_log(DRIVEN, counts=counts_about(432), ahead=1.8)
    assert "the antenna is about 1.8 m ahead of the rear axle, but the map has 0" in lines_of(columns)[-1]
    position = {"ahead_m": 1.8}
    assert not any("antenna" in line for line in lines_of(columns, position=position))


def test_no_centre_is_reported_if_steering_does_not_explain_yaw_rate():
    columns = field_log(DRIVEN, counts=counts_about(432))
    columns["steer"] = 432 + 30 * np.sin(columns["t"] * 1.7)
    assert "too little to evaluate the steering centre" in lines_of(columns)[-1]


@pytest.mark.parametrize("options", [["--describe"], ["--only", "replay", "--set", "plant.kind=bicycle"]])
def test_describe_and_replay_commands_report_the_health_of_the_log(tmp_path, call, options):
    pacsv.write_csv(pa.table(field_log(path(duration=30.0), counts=counts_about(370))), tmp_path / "log.csv")
    lines = ['time.column = "t"', 'speed.column = "speed"', "[steer]", 'column = "steer"', "offset = 432"]
    lines += [f"scale = {SCALE}", "[heading]", 'column = "heading"', 'convention = "enu"']
    (tmp_path / "map.toml").write_text("\n".join([*lines, "[position]", 'east = "east"', 'north = "north"']))
    out_of = [] if options == ["--describe"] else ["--out", str(tmp_path / "out")]
    status, out, err = call("twin", str(tmp_path / "log.csv"), "--map", str(tmp_path / "map.toml"), *options, *out_of)
    assert (status, err) == (0, "")
    assert "but the map has 432: the sensor has moved" in out


def test_log_health_is_printed_after_the_reason_for_a_rejection(tmp_path, call):
    columns = field_log(path(duration=120.0), counts=counts_about(432))
    kept = columns["t"] % 8.0 < 2.0
    pacsv.write_csv(pa.table({name: values[kept] for name, values in columns.items()}), tmp_path / "log.csv")
    lines = ['time.column = "t"', 'speed.column = "speed"', f'steer = {{ column = "steer", scale = {SCALE} }}']
    (tmp_path / "map.toml").write_text("\n".join([*lines, '[position]\neast = "east"', 'north = "north"']))
    status, out, err = call("twin", str(tmp_path / "log.csv"), "--map", str(tmp_path / "map.toml"), "--out", "out")
    assert (status, out) == (2, "")
    reason, health, *_ = err.splitlines()
    assert reason.endswith("a segment needs 5 s; record without pauses")
    assert health == (
        "log.csv: recorded in 15 bursts of 2.0 s, one every 8.0 s; a replay needs bursts of at least 5 s, a fit of 7 s"
    )
    assert not (tmp_path / "out").exists()
