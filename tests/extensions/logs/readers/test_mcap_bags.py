"""ROS 2 bags: messages written by mcap-ros2-support, a simulated run, and hostile files."""

import re
from math import cos, sin
from types import SimpleNamespace

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.readers import mcap as reader
from agrobot_mj.extensions.logs.readers import open_log
from agrobot_mj.extensions.logs.replay.result import replay

writer = pytest.importorskip("mcap_ros2.writer", reason="mcap-ros2-support is not installed (uv sync, or make install)")
LINE = "=" * 80
HEADER = f"{LINE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
HEADER += f"{LINE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
VECTORS = f"{LINE}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
FIX = f"std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n{HEADER}"
FIX += f"{LINE}\nMSG: sensor_msgs/NavSatStatus\nint8 status\nuint16 service\n"
IMU = "std_msgs/Header header\ngeometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
JOINTS = f"std_msgs/Header header\nstring[] name\nfloat64[] position\n{HEADER}"
VELOCITY = f"std_msgs/Header header\nfloat32 longitudinal_velocity\nfloat32 heading_rate\n{HEADER}"
DEMAND = f"std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n{HEADER}{LINE}\n"
DEMAND += "MSG: ackermann_msgs/AckermannDrive\nfloat32 steering_angle\nfloat32 speed\n"
KINDS = {
    "/gps/fix": ("sensor_msgs/msg/NavSatFix", FIX),
    "/imu": ("sensor_msgs/msg/Imu", IMU + HEADER + VECTORS),
    "/joints": ("sensor_msgs/msg/JointState", JOINTS),
    "/velocity": ("autoware_vehicle_msgs/msg/VelocityReport", VELOCITY),
    "/sim/truth/velocity": ("autoware_vehicle_msgs/msg/VelocityReport", VELOCITY),
    "/drive": ("ackermann_msgs/msg/AckermannDriveStamped", DEMAND),
    "/notes": ("std_msgs/msg/String", "string data"),
}
COUNT = 400


def content(k):
    """Yield topic and message for step `k` of a bag at 20 Hz."""
    yield "/imu", {"angular_velocity": {"x": 0, "y": 0, "z": 0.1 * sin(k / 20)}, "angular_velocity_covariance": [0] * 9}
    yield "/joints", {"name": ["front_left_steer", "front_right_steer", "wheel"], "position": [0.2, 0.1, 99.0]}
    for topic, speed in (("/velocity", 1.5), ("/sim/truth/velocity", 7.0)):
        yield topic, {"longitudinal_velocity": speed, "heading_rate": 0.0}
    yield "/drive", {"drive": {"steering_angle": 0.25, "speed": 2.0}}
    yield "/notes", {"data": "\x1b[31mhello"}
    if k % 2 == 0:
        status = {"status": -1 if k == 10 else 2, "service": 1}
        yield "/gps/fix", {"status": status, "latitude": 50.877 + 1e-6 * k, "longitude": 4.699 + 1e-6 * cos(k / 9)}


def stamped(k, topic, message):
    stamp = {"sec": 1_000_000 + k // 20, "nanosec": k % 20 * 50_000_000}
    return message if topic == "/notes" else {"header": {"stamp": stamp, "frame_id": "x"}, **message}


@pytest.fixture(params=["ZSTD", "LZ4", "NONE"])
def bag(request, tmp_path):
    mcap_writer = pytest.importorskip("mcap.writer")
    (tmp_path / "drive").mkdir()
    made = writer.Writer(
        str(tmp_path / "drive" / "drive_0.mcap"),
        chunk_size=20_000,
        compression=getattr(mcap_writer.CompressionType, request.param),
    )
    schemas = {topic: made.register_msgdef(*kind) for topic, kind in KINDS.items()}
    for k in range(COUNT):
        at = (5_000_000_000 + 50_000_000 * k) + 3_000_000  # the logger's own clock
        for topic, message in content(k):
            made.write_message(topic, schemas[topic], stamped(k, topic, message), log_time=at, publish_time=at)
    made.finish()
    return tmp_path / "drive" / "drive_0.mcap"


def test_messages_of_a_bag_are_converted_to_quantities(bag):
    log = open_log(bag.parent)
    column = {name: log.source[name].to_numpy(zero_copy_only=False) for name in log.source.column_names}
    assert (log.reader, log.missing) == ("mcap", "")
    assert column["t"] == pytest.approx(0.05 * np.arange(COUNT), abs=1e-6), "stamps of the headers"
    assert column["steer"] == pytest.approx(0.15)
    assert column["speed"] == pytest.approx(1.5), "the truth is left out"
    assert column["steer_demand"] == pytest.approx(0.25)
    assert column["yaw_rate"] == pytest.approx(0.1 * np.sin(np.arange(COUNT) / 20))
    assert np.isfinite(column["latitude"]).sum() == COUNT / 2 - 1
    assert np.nanmax(column["latitude"]) == pytest.approx(50.877398, abs=1e-9)
    assert set(column["quality"][::2]) == {0, 4}


def test_truncated_bag_is_read_up_to_the_truncation(bag):
    data = bag.read_bytes()
    bag.write_bytes(data[: len(data) // 2])
    log = open_log(bag)
    assert 100 < len(log.source) < 300
    told = re.search(r"is damaged after (\d+) messages", log.notes[0])
    assert int(told[1]) == pytest.approx(4.5 * len(log.source), abs=5)  # four in each row, a fix in every other one
    spoilt = bytearray(data)
    for k in range(len(data) // 3, len(data) // 2, 7):
        spoilt[k] ^= 0x55
    bag.write_bytes(spoilt)
    assert 50 < len(open_log(bag).source) < COUNT


def test_oversized_compressed_chunks_are_rejected(bag, monkeypatch):
    monkeypatch.setattr(reader, "MOST_RECORD_BYTES", 15_000)
    with pytest.raises(FieldLogError, match=r"a chunk exceeds 0.015 MB when unpacked|contains no messages"):
        open_log(bag)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"SQLite format 3\0" + bytes(100), "the bag is in SQLite format; convert it to MCAP"),
        (b"\x89MCAP0\r\n", "contains no messages of a known type"),
        (b"\x89MCAP0\r\n\x03" + b"\xff" * 20, "is damaged after 0 messages"),
    ],
)
def test_malformed_bags_are_rejected_with_the_reason(tmp_path, data, told):
    (tmp_path / "bag").write_bytes(data)
    with pytest.raises(FieldLogError, match=told):
        open_log(tmp_path / "bag")


def test_fix_quality_is_taken_from_the_message_status():
    for status, quality in ((-1, 0), (0, 1), (1, 2), (2, 4), (9, 0)):
        fix = SimpleNamespace(status=SimpleNamespace(status=status), latitude=50.0, longitude=4.0)
        found = reader.CONTENT["sensor_msgs/msg/NavSatFix"](fix)
        assert found["quality"] == quality
        assert ("latitude" in found) == (quality > 0)


def test_replay_of_an_exported_run_reproduces_its_results(tmp_path):
    keys = {"plant.kind": "bicycle", "sensors.gyro.enabled": True, "sensors.imu.enabled": True, "duration_s": 45}
    log = run(load_scenario("figure_eight", keys))
    bag = pytest.importorskip("agrobot_mj.extensions.links.ros2.bag", reason="without the extension links")
    bag.write_mcap(log.scenario, log.signals, tmp_path / "run")
    read = open_log(tmp_path / "run")
    found = replay(read.source, read.checked_map(), log.scenario).metrics
    assert found["yaw_rate"]["explained"] > 0.98
    assert abs(found["yaw_rate"]["lag_s"]) < 0.03
    assert found["position"]["windows_rms"] < 0.04
