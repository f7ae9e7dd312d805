"""Sensor calibration from simulated logs; logs without sufficient information are rejected."""

from functools import cache
from math import radians

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from machines import log_of
from stranger import STEP_S, behind_play, drive, hidden, inputs

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs import calibrate as calibration
from agrobot_mj.extensions.logs.calibrate import calibrate
from agrobot_mj.extensions.logs.maps import built_in
from agrobot_mj.extensions.logs.words import sentences
from agrobot_mj.scenario.loading import load_scenario

BICYCLE = load_scenario("straight_line", {"plant.kind": "bicycle"})


quickly = pytest.mark.usefixtures("quick_fit")


@pytest.fixture(scope="module")
def log():
    return log_of(3, plant__front_cornering_stiffness_n_rad=11_000.0, plant__rear_cornering_stiffness_n_rad=24_000.0)


def calibrated(table, log_map=None, scenario=BICYCLE):
    """Return the calibration from the first 40 s of a log."""
    return calibrate([table], log_map, scenario, 0.0, 40.0)


@pytest.fixture(scope="module")
def sound(log):
    """Return the calibration of a log without errors."""
    return calibrated(log.signals)


@cache
def gyro_log(h, age, cruise=None, swing=1.0):
    """Return the log of a machine with gyro and one antenna. The steering sensor has delay, offset and scale error."""
    fine = np.arange(0, 80, STEP_S / 2)
    speed, sensor = inputs(0, fine + 40)  # a slow half, then a fast half
    sensor *= swing
    speed = speed if cruise is None else np.full(len(fine), cruise)
    x, y, psi, rate = drive(h, speed, behind_play(sensor, radians(h.play)))
    steps, t = STEP_S * np.arange(len(x)), np.arange(9.0, 79.0, 0.05)
    rng = np.random.default_rng(5)
    x, y, psi, rate = (np.interp(t, steps, each) for each in (x, y, psi, rate))
    noise = rng.standard_normal((5, len(t)))
    return pa.table(
        {
            "t": t,
            "steer_measured": 1.125 * np.interp(t - age, fine, sensor) + radians(0.9) + radians(0.05) * noise[0],
            "valve_voltage": np.full(len(t), 6.0),
            "speed_hat": np.interp(t, fine, speed) + 0.01 * noise[1],
            "gyro": rate + radians(0.1) + radians(0.1) * noise[2],
            "gnss_x": x + h.ahead * np.cos(psi) - h.left * np.sin(psi) + 0.01 * noise[3],
            "gnss_y": y + h.ahead * np.sin(psi) + h.left * np.cos(psi) + 0.01 * noise[4],
            "gnss_quality": np.full(len(t), 2.0),
        }
    )


def test_steering_delay_and_scale_are_identified_relative_to_the_gyro():
    h = hidden(0)._replace(play=0.5)
    found = calibrate([gyro_log(h, 0.1)], None, BICYCLE).found
    truth = {"steer.scale": 1 / 1.125, "steer.offset": radians(0.9), "steer.delay_s": 0.1, "position.ahead_m": h.ahead}
    for key, true in truth.items():
        assert not found[key].excludes(true), (key, true, found[key])
    assert found["steer.offset"].value == pytest.approx(radians(0.9), abs=radians(0.1))
    assert "heading.offset" not in found


@pytest.fixture(scope="module")
def cruising():
    """Return the calibration of a log with constant speed."""
    return calibrate([gyro_log(hidden(0), 0.1, 2.0)], None, BICYCLE)


def test_latency_of_the_speed_sensor_is_not_identified_at_constant_speed(cruising):
    """Otherwise a random latency would fit the noise of the speed to the noise of the positions with a narrow
    interval."""
    found = cruising
    age = found.found["speed.delay_s"]
    assert (age.value, age.identified) == (0.0, False)
    assert found.calibrated.speed == found.log_map.speed
    assert any(
        "The delay of the speed requires changes of the speed" in line for line in sentences(found, BICYCLE.tractor)
    )


def test_constant_speed_triples_all_intervals_except_steering_centre(cruising, monkeypatch):
    log = gyro_log(hidden(0), 0.1, 2.0)
    monkeypatch.setattr(calibration, "fit", lambda *given: cruising.fit)
    monkeypatch.setattr(calibration, "scrub", lambda scenario: 0.0)  # independent of the speeds of a log
    wide = calibrate([log], None, BICYCLE).found
    monkeypatch.setattr(calibration, "TWO_SPEEDS", 0.0)
    narrow = calibrate([log], None, BICYCLE).found
    for key, wider in (("steer.scale", 3.0), ("position.left_m", 3.0), ("steer.offset", 1.0)):
        assert wide[key].high - wide[key].low == pytest.approx(wider * (narrow[key].high - narrow[key].low), rel=1e-6)


@quickly
def test_latency_and_antenna_position_are_not_identified_on_a_straight():
    """The steering backlash hides half of the small corrections, or all of them if they are smaller."""
    found = calibrate([gyro_log(hidden(0), 0.1, swing=0.18)], None, BICYCLE)
    assert {key for key, each in found.found.items() if each.identified} == {
        *("steer.offset", "steer.scale", "steer.scale_right")
    }
    assert not found.found["steer.offset"].excludes(radians(0.9))
    assert any(line.startswith("Delays require bends") for line in sentences(found, BICYCLE.tractor))
    with pytest.raises(FieldLogError, match="the wheel angle in bends exceeds the steering play"):
        calibrate([gyro_log(hidden(0), 0.1, swing=0.12)], None, BICYCLE)


@quickly
def test_shift_of_the_steering_centre_between_log_halves_is_detected(log, sound):
    assert not any("The steering centre changes" in line for line in sentences(sound, BICYCLE.tractor))
    t, read = (np.asarray(log.signals[name]) for name in ("t", "steer_measured"))
    at = log.signals.column_names.index("steer_measured")
    slipped = log.signals.set_column(at, "steer_measured", pa.array(read + radians(3) * (t > 20)))
    moved = calibrated(slipped)
    for key in ("steer.offset", "position.delay_s"):
        assert sound.found[key].identified
        assert not moved.found[key].identified
    told = sentences(moved, BICYCLE.tractor)
    assert not any("Delays require" in line for line in told)
    line, *others = [line for line in told if "steering centre" in line]
    assert line.startswith("The steering centre changes")
    assert not others
    first, second = (float(line.split(word)[1].split()[0]) for word in (" changes from ", " of the drive to "))
    assert second - first == pytest.approx(radians(3), abs=radians(0.2))


@quickly
def test_one_scale_is_fitted_if_the_right_scale_is_implausible(log, sound, monkeypatch):
    fit = calibration.fit

    def poor_right_scale(data, names, known):
        found = fit(data, names, known)
        right = np.array([name == "steer_right" for name in found.names])
        return found._replace(value=np.where(right, 0.5, found.value))

    monkeypatch.setattr(calibration, "fit", poor_right_scale)
    found = calibrated(log.signals).found
    assert "steer.scale_right" in sound.found
    assert "steer.scale_right" not in found
    assert found["steer.scale"].value == pytest.approx(sound.found["steer.scale"].value, rel=0.05)


@quickly
def test_angle_in_degrees_mapped_as_radians_is_reported(log):
    at = log.signals.column_names.index("steer_measured")
    wrong = log.signals.set_column(at, "steer_measured", pc.multiply(log.signals["steer_measured"], 180 / np.pi))
    told = sentences(calibrated(wrong), BICYCLE.tractor)
    assert any('The readings seem to be in deg; if so, set unit = "deg"' in line for line in told)


def test_gyro_in_the_wrong_unit_is_rejected(log):
    at = log.signals.column_names.index("gyro")
    wrong = log.signals.set_column(at, "gyro", pc.multiply(log.signals["gyro"], np.pi / 180))
    with pytest.raises(FieldLogError, match=r"turns \d\d times as fast as the gyro; check the unit and the column"):
        calibrate([wrong], None, BICYCLE)


@quickly
def test_gyro_mapped_as_steering_angle_is_rejected():
    log, names = gyro_log(hidden(0), 0.1), {"gyro": "steer_measured", "steer_measured": "gyro"}
    with pytest.raises(FieldLogError, match=r"that the columns of \[steer\] and \[yaw_rate\] are not swapped"):
        calibrate([log.rename_columns([names.get(name, name) for name in log.column_names])], None, BICYCLE)


@quickly
def test_reverse_driving_with_an_unsigned_speed_is_reported(log):
    at, reverse = log.signals.column_names.index("steer_measured"), pc.negate(log.signals["steer_measured"])
    found = calibrated(log.signals.set_column(at, "steer_measured", reverse))
    assert any("unless most of the drive was in reverse" in line for line in sentences(found, BICYCLE.tractor))


@quickly
def test_wheelbase_error_changes_the_identified_steering_scale(log):
    scenario = BICYCLE.changed({"tractor.wheelbase_m": 1.54})
    found = calibrated(log.signals, None, scenario)
    assert found.found["steer.scale"].value == pytest.approx(1.1, abs=0.03)
    told = sentences(found, scenario.tractor)
    assert any("proportional to the assumed wheelbase of 1.54 m" in line for line in told)


def test_steering_limit_below_the_recorded_angles_is_reported(sound):
    narrow = BICYCLE.changed({"tractor.steer_limit_deg": 4.0}).tractor
    assert any("but tractor.steer_limit_deg is 4; increase the limit" in line for line in sentences(sound, narrow))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"steer_measured": 0.0}, "a straight-line fit to the steering measurements explains 0 %"),
        ({"gnss_quality": 0.0}, "contain 0 positions"),
        ({"speed_hat": 0.0}, "never reaches"),
    ],
)
def test_logs_with_too_little_steering_excitation_are_rejected(log, change, told):
    table = log.signals
    for name, value in change.items():
        table = table.set_column(table.column_names.index(name), name, pa.array(np.full(len(table), value)))
    with pytest.raises(FieldLogError, match=told):
        calibrate([table], None, BICYCLE)


@pytest.mark.parametrize("unit", [3.6, 0.447])
def test_speed_in_the_wrong_unit_is_rejected(log, unit):
    """The fit would attribute the error to scale and centre and report both as identified."""
    place = log.signals.column_names.index("speed_hat")
    wrong = log.signals.set_column(place, "speed_hat", pc.multiply(log.signals["speed_hat"], unit))
    with pytest.raises(
        FieldLogError,
        match=r"the positions cover \d+ m, but the speed gives \d+ m; check the "
        r"unit of",
    ):
        calibrate([wrong], None, BICYCLE)


def exchanged(table):
    """Return the log with swapped names of its position columns."""
    names = {"gnss_x": "gnss_y", "gnss_y": "gnss_x"}
    return table.rename_columns([names.get(name, name) for name in table.column_names])


def test_comparison_with_the_gyro_rejects_swapped_position_axes(log):
    told = r"course of the positions turns right where the gyro turns left; check whether the east and north columns"
    with pytest.raises(FieldLogError, match=told):
        calibrate([exchanged(log.signals)], None, BICYCLE)


@quickly
def test_swapped_position_axes_that_mirror_the_steering_are_reported(log):
    blind = built_in(log.signals.column_names, "log").model_copy(update={"yaw_rate": None, "heading": None})
    for table, side in ((log.signals, "left"), (exchanged(log.signals), "right")):
        found = calibrated(table, blind)
        assert found.positive == side
        doubts = [
            line
            for line in sentences(found, BICYCLE.tractor)
            if "unless the east and north columns of [position] are swapped" in line
        ]
        assert len(doubts) == (side == "right")


@quickly
def test_short_log_calibrates_sensors_but_identifies_no_tyre_stiffness(log, tmp_path, call):
    arguments = "twin", "--only", "identify", "log.parquet", "--set", "plant.kind=bicycle", "--out", "found"
    pq.write_table(log.signals, tmp_path / "log.parquet")
    assert call(*arguments)[0] == 0
    assert (tmp_path / "found" / "vehicle.json").exists()
    pq.write_table(log.signals.slice(0, 500), tmp_path / "log.parquet")
    status, out, err = call(*arguments)
    assert (status, out.count("vehicle.json")) == (1, 0)
    assert not (tmp_path / "found" / "vehicle.json").exists()
    assert "complete windows of 5 s in motion" in err
    assert "Results that this log supports:" in out
    assert "steer.scale" in out


@quickly
def test_calibrate_command_writes_the_calibrated_map(log, tmp_path, call):
    pq.write_table(log.signals.slice(0, 700), tmp_path / "log.parquet")
    status, out, err = call(
        "twin", "--only", "calibrate", "log.parquet", "--set", "plant.kind=bicycle", "--out", "found"
    )
    assert (status, err) == (0, "")
    text = (tmp_path / "found" / "map.toml").read_text()
    assert text.strip() in out
    assert " to " in text.partition("offset = ")[2].splitlines()[0]
    assert (tmp_path / "found" / "calibration.json").is_file()
