"""CAN logs: exact reading of frames written by python-can, and known properties of a public tractor log."""

from math import atan, degrees, pi, radians

import numpy as np
import pytest
from public import checkout

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.readers import open_log
from agrobot_mj.extensions.logs.readers.can import signals_of
from agrobot_mj.extensions.logs.recording import read_recording

MF7720 = "Show_All_CAN_Messages/Show_All_CAN_Messages/scan mf7720 bl 270922 speedsteer enable.txt"
T = 0.05 * np.arange(200)
CURVATURE = 0.1 * np.sin(T)  # Left positive [1/m]
LATITUDE_1E7 = 50.877e7  # At the start, from which the tractor drives north at 1.5 m/s [1e-7 deg]


def little(value, size):
    return round(value).to_bytes(size, "little", signed=value < 0)


def frames():
    """Yield time, identifier and data of each frame, as defined in ISO 11783-7 and NMEA 2000."""
    for t, kappa in zip(T.tolist(), CURVATURE.tolist(), strict=True):
        # 0.25 /km a bit, -8032 /km at 0, to the right; 1 mm/s; 1e-4 rad from north, 1 cm/s; 1e-7 deg
        yield t, 0x0CAC1C13, little((8032 - 1000 * kappa) / 0.25, 2) + b"\xff" * 6
        yield t, 0x18FE4926, little(1500, 2) + b"\xff" * 5 + b"\xfd"
        yield t + 0.01, 0x09F80203, b"\0\xfc" + little(1e4 * radians(30), 2) + little(150, 2) + b"\xff\xff"
        yield t + 0.01, 0x09F80103, little(LATITUDE_1E7 + 135 * t, 4) + little(-4.699e7, 4)
        yield t + 0.01, 0x0CF00400, b"\xff" * 8  # an engine, which is nobody's business here


@pytest.fixture(params=["CanutilsLogWriter", "CSVWriter"])
def written(request, tmp_path):
    can = pytest.importorskip("can", reason="python-can is not installed (uv sync, or make install)")
    file = tmp_path / "bus.txt"
    writer = getattr(can, request.param)(str(file))
    for t, identifier, data in frames():
        writer(can.Message(timestamp=1e9 + t, arbitration_id=identifier, is_extended_id=True, data=data))
    writer.stop()
    return file


def column(log, name):
    """Return times and values of a quantity."""
    t, values = (log.source[each].to_numpy(zero_copy_only=False) for each in ("t", name))
    return t[np.isfinite(values)], values[np.isfinite(values)]


def test_frames_of_a_python_can_log_are_converted_to_quantities(written):
    log = open_log(written)
    assert (log.reader, log.notes[0]) == ("can", "from PGN 44032 of 13: curvature")
    t, kappa = column(log, "curvature")
    assert t == pytest.approx(T, abs=1e-6)
    assert kappa == pytest.approx(CURVATURE, abs=0.13e-3)
    assert column(log, "speed")[1] == pytest.approx(1.5)
    assert column(log, "course")[1] == pytest.approx(radians(60), abs=1e-4)
    assert column(log, "latitude")[1] == pytest.approx(1e-7 * (LATITUDE_1E7 + 135 * T), abs=1e-7)
    assert column(log, "longitude")[1] == pytest.approx(-4.699)
    assert len(log.source) == 2 * len(T)


def test_curvature_is_converted_to_steering_angle_if_wheelbase_is_known(written):
    log = open_log(written)
    assert log.log_map is None
    with pytest.raises(FieldLogError, match=r'no wheel angle; .* curvature, with unit = "1/m" and wheelbase_m'):
        log.checked_map()
    tables = log.tables | {"steer": {"column": "curvature", "unit": "1/m", "wheelbase_m": 2.5}}
    steer = read_recording(log.source, LogMap.model_validate(tables), 2.0).steer
    assert steer.value == pytest.approx([atan(2.5 * kappa) for kappa in CURVATURE], abs=4e-4)
    del tables["steer"]["wheelbase_m"]
    with pytest.raises(ValueError, match="wheelbase_m: is missing for unit"):
        LogMap.model_validate(tables)
    tables["steer"] |= {"unit": "rad", "wheelbase_m": 2.5}
    with pytest.raises(ValueError, match="wheelbase_m: applies to a curvature only"):
        LogMap.model_validate(tables)


def test_speed_message_with_the_most_values_is_used(tmp_path):
    lines = [f"({k / 10:.6f}) can0 18FE4926#{'DC05FFFFFFFFFFFD' if k % 2 else 'FFFFFFFFFFFFFFFF'}" for k in range(40)]
    lines += [f"({4 + k / 10:.6f}) can0 09F80203#00FC0000{'C800'}FFFF" for k in range(40)]
    (tmp_path / "log").write_text("\n".join(lines) + "\n(99.0) can0 18FE49")
    log = open_log(tmp_path / "log")
    assert column(log, "speed")[1] == pytest.approx(2.0)
    assert "speed is also in PGN 65097 of 26, with fewer values" in log.notes
    assert any(note.startswith("1 damaged lines are omitted (first: line 81") for note in log.notes)


def test_reverse_travel_bits_and_unavailable_values_are_decoded():
    def decoded(identifier, text):
        return {s.quantity: s.of_frame(bytes.fromhex(text)) for s in signals_of(identifier)[1]}

    assert decoded(0x18FE4926, "DC05FFFFFFFFFFFC") == {"speed": -1.5}, "in reverse"
    assert decoded(0x18FE4926, "00FBFFFFFFFFFFFD") == {"speed": None}
    assert decoded(0x18FE4926, "DC") == {"speed": None}
    assert decoded(0x18FEF100, "FF0024FFFFFFFFFF")["wheel_speed"] == pytest.approx(10.0), "36 km/h"
    assert decoded(0x18FEE800, "002D0012FFFFFFFF") == {"course": 0.0, "speed": pytest.approx(5.0)}
    assert decoded(0x18F00900, "7F7D00FF7D00FFFF") == {"steering_wheel": 0.0, "yaw_rate": 128 / 8192}
    assert decoded(0x09F1130A, "00A0860100FFFFFF")["yaw_rate"] == pytest.approx(-1e5 / 32e6), "to the right"
    assert decoded(0x09F1130A, "00FFFFFF7FFFFFFF") == {"yaw_rate": None}
    assert decoded(0x18FEF300, "00C0695A0080DC51")["latitude"] == pytest.approx(-58.3, abs=0.05)
    assert decoded(0x09F1120A, "00983A0000000000")["heading"] == pytest.approx(pi / 2 - 1.5)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"LOGG" + bytes(200), "this is a BLF log; convert it with: python -m can.logconvert"),
        (b"date Mon Nov 23\nbase hex\n", "is a ASC log"),
        (b"(1.0) can0 0CF00400#FFFFFFFFFFFFFFFF\n" * 9, "contains no known signals"),
        (b"(1.0) can0 0CAC1C13#807D\n" + b"(1.0) can0 0CAC1C13#8\xff7D\n" * 9, "9 of 10 lines cannot be read"),
        (b"(1.0) can0 0CAC1C13#807D\n" + b"(" * 10**6, "line 2 has more than 65536 bytes"),
    ],
)
def test_malformed_can_logs_are_rejected_with_the_reason(tmp_path, content, told):
    (tmp_path / "log").write_bytes(content)
    with pytest.raises(FieldLogError, match=told):
        open_log(tmp_path / "log")


def test_public_can_log_gives_the_known_steering_angles():
    """The log contains steering-wheel angle and curvature of a Massey Ferguson 7720 with a wheelbase of 2.88 m."""
    folder = checkout("BL08FR/AOG-Canbus-tools-program-s", "327078f5")
    log = open_log(folder / MF7720)
    (tw, wheel), (tc, kappa) = column(log, "steering_wheel"), column(log, "curvature")
    assert len(wheel) / np.ptp(tw) == pytest.approx(73.5, abs=0.1)
    assert len(kappa) / np.ptp(tc) == pytest.approx(7.8, abs=0.1)
    angle = np.array([degrees(atan(2.88 * each)) for each in kappa])
    assert 1 / np.abs(kappa).max() == pytest.approx(2.5, abs=0.02), "radius at full lock"
    t = np.arange(tc[0] + 1, tc[-1] - 1, 0.05)
    wheels = np.interp(t, tc, angle)
    for steps, rate in ((20, 59), (10, 88)):
        assert np.abs(wheels[steps:] - wheels[:-steps]).max() / (0.05 * steps) == pytest.approx(rate, abs=1)
    lag, (left, right) = best_lag(t, wheels, tw, wheel / (2 * pi))
    assert lag == pytest.approx(0.12, abs=0.02)
    assert 73 < left < 75.5
    assert 70 < right < 73


def best_lag(t, wheels, tw, turns):
    """Return lag [s] and wheel angle per turn to each side [deg] that best explain motion of the wheels off stops."""
    found = []
    inside = np.convolve(np.abs(wheels) < 44, np.ones(9), "valid") == 9
    for lag in np.arange(0.0, 0.3, 0.01):
        moved = np.interp(t - lag, tw, turns)
        moved = (moved[8:] - moved[:-8])[inside]
        parts = np.stack([np.maximum(moved, 0), np.minimum(moved, 0)], axis=1)
        scale, left, *_ = np.linalg.lstsq(parts, (wheels[8:] - wheels[:-8])[inside], rcond=None)
        found.append((float(left[0]), float(lag), scale.tolist()))
    return min(found)[1:]
