"""Timed lines of a logging program: sentences of a receiver, and JSON of a steering sensor and an IMU."""

import numpy as np
import pytest
from field_logs import field_log, path

from agrobot_mj.core.nmea import sentence
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.readers import open_log

ORIGIN = 51.0, 4.0
NORTH_M, EAST_M = 111_248.3, 70_197.7  # Length of a degree at the origin by the series of WGS 84 [m]
CENTRE, DEG_PER_COUNT = 1538, 0.013


def angle_text(value, digits):
    """Return an angle in degrees and minutes, in the format of an NMEA sentence."""
    return f"{int(value):0{digits}d}{60 * (value % 1):010.7f}"


def lines_of(columns):
    """Return the lines of a log, in which every tenth row has sentences of the receiver."""
    lines, start = [], np.datetime64("2026-05-04T23:59:40", "us")
    for k, t in enumerate(columns["t"]):
        time, heading = start + np.timedelta64(round(1e6 * t), "us"), (90 - columns["heading"][k]) % 360
        lines.append(f'{time}: {{"yaw":{heading:.3f},"roll":1.25,"was":{columns["steer"][k]:.0f},"motor":false}}')
        if k % 10 == 0:
            latitude, longitude = ORIGIN[0] + columns["north"][k] / NORTH_M, ORIGIN[1] + columns["east"][k] / EAST_M
            place = angle_text(latitude, 2), "N", angle_text(longitude, 3), "E"
            vtg = sentence("GNVTG", "", "T", "", "M", f"{columns['speed'][k] * 3600 / 1852:.3f}", "N", "", "K", "D")
            gns = sentence("GNGNS", "000000.00", *place, "RRRR", 31, 0.5, "10.0", 39.4, 1.0, "0000", "V")
            lines += [f"{time}: {each.decode().strip()}" for each in (vtg, gns)]
    return lines


@pytest.fixture
def columns():
    driven = path(duration=40.0, swing_deg=12.0)
    return field_log(driven, every=1, counts=lambda wheel: CENTRE + np.degrees(wheel) / DEG_PER_COUNT)


def test_values_have_the_time_stamps_of_the_logged_lines(tmp_path, columns):
    (tmp_path / "log").write_text("\n".join(lines_of(columns)))
    log = open_log(tmp_path / "log")
    table = {name: log.source[name].to_numpy(zero_copy_only=False) for name in log.source.column_names}
    assert log.reader == "lines"
    assert table["t"] == pytest.approx(columns["t"], abs=1e-6), "and goes on after midnight"
    assert table["was"] == pytest.approx(columns["steer"])
    assert np.unwrap(table["heading"]) == pytest.approx(np.radians(np.unwrap(columns["heading"], period=360)), abs=1e-4)
    fixed = table["quality"] == 4
    assert fixed.sum() == len(columns["t"]) / 10
    assert (table["latitude"][fixed] - ORIGIN[0]) * NORTH_M == pytest.approx(columns["north"][fixed], abs=1e-3)
    assert table["speed"][fixed] == pytest.approx(columns["speed"][fixed], abs=1e-3)
    assert log.log_map.speed.of == "antenna"


def test_damaged_lines_are_counted_and_too_many_rejected(tmp_path, columns):
    lines = lines_of(columns)
    lines[50], lines[70], lines[90] = lines[50][:-9], "what was that?", lines[90].split("{")[0] + "[1, 2]"
    (tmp_path / "log").write_text("\n".join(lines))
    assert any("3 damaged lines are omitted (first: line 51" in note for note in open_log(tmp_path / "log").notes)
    (tmp_path / "log").write_text("\n".join(lines[:30] + ["?"] * 15))
    with pytest.raises(FieldLogError, match=r"15 of 45 lines cannot be read \(first: line 31"):
        open_log(tmp_path / "log")


@pytest.mark.usefixtures("quick_fit")
def test_log_of_time_stamped_lines_is_calibrated_without_a_map(tmp_path, columns, asked):
    (tmp_path / "log").write_text("\n".join(lines_of(columns)))
    known = "--machine", "utility", "--set", "tractor.wheelbase_m=2.5"
    found, err = asked("twin", "log", "--only", "calibrate", *known)
    assert err == ""
    centre = found["calibrate"]["found"]["steer.offset"]
    assert centre["low"] < CENTRE < centre["high"]
    assert centre["high"] - centre["low"] < 40
