"""Typical logs of users: slow sensors, noisy positions, antennas ahead of the axle, and bursts."""

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pytest
from field_logs import WHEELBASE_M, field_log, field_map, path, recorded

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.calibrate import calibrate
from agrobot_mj.extensions.logs.checks import check_columns
from agrobot_mj.extensions.logs.direction import with_direction
from agrobot_mj.extensions.logs.maps import AGOPENGPS_MAP, PositionColumns
from agrobot_mj.extensions.logs.pieces import bursts, pieces
from agrobot_mj.extensions.logs.series import scatter
from agrobot_mj.scenario.loading import load_scenario

UTILITY = load_scenario("straight_line", {"machine": "utility", "tractor.wheelbase_m": WHEELBASE_M})


@pytest.mark.parametrize("share", [pytest.param(0.3, marks=pytest.mark.slow), 0.45])
def test_log_with_randomly_repeated_headings_is_calibrated(share):
    columns = field_log(path(duration=40.0), every=1)
    repeated = np.random.default_rng(4).random(len(columns["t"])) < share
    source = np.maximum.accumulate(np.where(repeated, 0, np.arange(len(repeated))))
    columns["heading"] = columns["heading"][source]
    slow = np.arange(len(repeated)) % 10 == 0
    for name in ("east", "north"):
        columns[name] = np.where(slow, columns[name], np.nan)
    done = calibrate([pa.table(columns)], field_map(columns), UTILITY)
    found = done.found
    note = f"log: {repeated[1:].sum()} repeated values of 'heading' (from a slow or coarse sensor) are omitted"
    assert note in done.pieces.notes
    assert not found["steer.scale"].excludes(1.0)
    assert abs(found["steer.offset"].value) < 0.1


@pytest.mark.parametrize(("speed", "noise_m", "swing_deg"), [(5.0, 0.26, 4.0), (0.4, 0.15, 15.0), (2.0, 0.26, 8.0)])
def test_noisy_positions_do_not_reverse_the_direction_of_travel(speed, noise_m, swing_deg):
    driven = path(speed=speed, swing_deg=swing_deg)
    recording = recorded(field_log(driven, every=10, noise_m=noise_m, heading=False))
    assert scatter(recording.position.value) == pytest.approx(noise_m, rel=0.2)
    found = with_direction(recording)
    assert found.reverse_m == 0.0
    assert found.recording.speed.value.min() > 0


def test_rejection_names_inaccurate_positions_without_heading_as_reason():
    columns = field_log(path(duration=40.0), every=10, noise_m=0.26, heading=False)
    told = "that the log has bends in both directions, or add a heading or a gyro, because the positions scatter by 2"
    with pytest.raises(FieldLogError, match=told):
        calibrate([pa.table(columns)], field_map(columns), UTILITY)
    better = field_log(path(duration=40.0), every=10, noise_m=0.02, heading=False)
    assert abs(calibrate([pa.table(better)], field_map(better), UTILITY).found["steer.offset"].value) < 0.3


@pytest.mark.parametrize("noise_m", [0.01, 0.1])
def test_long_reverse_section_is_detected_from_noisy_positions(noise_m):
    driven = path(reverse=[(20.0, 32.0)])
    found = with_direction(recorded(field_log(driven, every=10, noise_m=noise_m, heading=False)))
    t, value = found.recording.speed
    wrong = np.sign(value) != np.sign(np.interp(t, driven[0], driven[1]))
    assert np.mean(wrong[np.abs(value) > 0.5]) < 0.01
    assert "steering" in found.how


def test_steering_corrects_travel_direction_after_position_jumps():
    """If a receiver alternates between two solutions, the positions jump back and forth, which resembles reversals."""
    columns = field_log(path(duration=90.0), every=10, noise_m=0.02, heading=False)
    t, yaw = columns["t"], path(duration=90.0)[5][::10]
    for start in (20.0, 50.0):
        lag = np.interp(t, [start, start + 1.0, start + 2.5], [0.0, 4.0, 0.0], left=0, right=0)
        columns["east"] -= lag * np.cos(yaw)
        columns["north"] -= lag * np.sin(yaw)
    found = with_direction(recorded(columns))
    assert found.reverse_m == 0.0


def test_speed_mapped_as_a_signed_value_keeps_its_sign():
    columns = field_log(path(reverse=[(20.0, 32.0)]), heading=False)
    assert with_direction(recorded(columns)).reverse_m > 10
    assert with_direction(recorded(columns, speed={"signed": True})).reverse_m == 0.0
    assert pieces([recorded(columns, speed={"signed": True})]).signed


def test_rejection_names_a_wrong_antenna_position_as_the_reason():
    """The machine turns nearly on the spot: the track length is 40 m by positions, but 23 m by speed."""
    driven = path(speed=0.5, swing_deg=65.0)
    columns = field_log(driven, ahead=5.0)
    with pytest.raises(
        FieldLogError, match=r"an antenna [45]\.\d m ahead of or behind the rear axle .* set position.ahead_m"
    ):
        check_columns([recorded(columns)])
    check_columns([recorded(columns, position={"ahead_m": 5.0})])
    with pytest.raises(FieldLogError, match="check the unit of"):
        check_columns([recorded(columns, position={"ahead_m": 5.0}, speed={"scale": 3.0})])


def test_log_recorded_in_bursts_is_reported_with_length_and_period():
    columns = field_log(path(duration=120.0))
    kept = columns["t"] % 8.0 < 2.0
    recording = recorded({name: values[kept] for name, values in columns.items()})
    found = bursts(recording)
    assert (found.number, found.length, found.period) == (15, pytest.approx(2.0, abs=0.1), pytest.approx(8.0))
    with pytest.raises(FieldLogError, match=r"15 bursts of \d.\d s, one every 8\.0 s, .* needs 5 s; record with"):
        pieces([recording])
    longer = {name: values[columns["t"] % 12.0 < 6.0] for name, values in columns.items()}
    with pytest.raises(FieldLogError, match=r"record without pauses, because a fit uses segments of at least 7 s"):
        calibrate([pa.table(longer)], field_map(columns), UTILITY)
    assert bursts(recorded(longer)).length == pytest.approx(6.0, abs=0.1)
    assert bursts(recorded(columns)) is None


def test_describe_command_accepts_words_as_fix_quality(tmp_path, call):
    columns = field_log(path()) | {"fix": ["RTK Fixed"] * 1200}
    pacsv.write_csv(pa.table(columns), tmp_path / "log.csv")
    lines = ['time.column = "t"', 'steer.column = "steer"', 'speed.column = "speed"', 'heading.column = "heading"']
    lines += ['heading.convention = "enu"', "[position]", 'east = "east"', 'north = "north"', 'quality = "fix"']
    (tmp_path / "map.toml").write_text("\n".join([*lines, 'accepted = ["RTK Fixed"]']))
    status, out, err = call("twin", "--describe", str(tmp_path / "log.csv"), "--map", str(tmp_path / "map.toml"))
    assert (status, err) == (0, "")
    assert "The log has the columns for replay, identify and calibrate: " in out
    assert "position.quality = fix" in out


def test_agopengps_speed_is_calibrated_as_the_speed_of_the_antenna():
    """In bends, an antenna ahead of the rear axle moves faster than the axle."""
    t, u, wheel, x, y, yaw = path(swing_deg=25.0)
    columns = field_log((t, np.hypot(u, 1.5 * np.gradient(yaw, t)), wheel, x, y, yaw), ahead=1.5, heading=False)
    columns |= {"time_s": columns["t"], "steer_angle_deg": -columns["steer"], "speed_km_h": 3.6 * columns["speed"]}
    log_map = AGOPENGPS_MAP.model_copy(update={"position": PositionColumns(east="east", north="north")})
    found = calibrate([pa.table(columns)], log_map, UTILITY).found
    for key, true in (("position.ahead_m", 1.5), ("position.delay_s", 0.0), ("steer.scale", 1.0)):
        assert not found[key].excludes(true), (key, found[key])
