"""MCAP export of a run: a ROS 2 decoder reads every value of the log; missing parts are reported."""

import json
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError, import_extra
from agrobot_mj.extensions.links.ros2.bag import export_run, write_mcap
from agrobot_mj.extensions.links.ros2.content import EPOCH_NS
from agrobot_mj.extensions.links.ros2.definitions import RECORDED
from agrobot_mj.simulation.storage import write_log

UNIT = {"sensors.imu.enabled": True, "sensors.gyro.enabled": True, "sensors.wheel_speed.enabled": True}
LOSS = {"fault": [{"kind": "gnss_loss", "start_s": 1.0, "end_s": 2.0}]}


@pytest.fixture(scope="module")
def log():
    return run(load_scenario("circle", {"duration_s": 3.0, **UNIT, **LOSS}))


@pytest.fixture(scope="module")
def read(log, tmp_path_factory):
    """Return pairs of time since the start [s] and decoded message, by topic."""
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap is not installed (pip install agrobot-mj[mcap])")
    file = tmp_path_factory.mktemp("bag") / "run.mcap"
    count = write_mcap(log.scenario, log.signals, file)
    found = {}
    for each in reader.read_ros2_messages(str(file)):
        found.setdefault(each.channel.topic, []).append(((each.log_time_ns - EPOCH_NS) / 1e9, each.ros_msg))
    assert sum(map(len, found.values())) == count
    return found


def test_every_topic_has_one_message_per_tick_with_its_time(read, log):
    assert set(read) == set(RECORDED) - {"/cmd_vel"}
    for topic, messages in read.items():
        if topic not in ("/path", "/tf_static"):
            np.testing.assert_allclose([t for t, _ in messages], log.column("t"), atol=1e-9)
    for t, message in read["/odometry"]:
        assert (message.header.stamp.sec * 10**9 + message.header.stamp.nanosec - EPOCH_NS) / 1e9 == pytest.approx(t)


@pytest.mark.parametrize(
    ("topic", "column", "value"),
    [
        ("/odometry", "rear_x_hat", lambda m: m.pose.pose.position.x),
        ("/odometry", "speed_hat", lambda m: m.twist.twist.linear.x),
        ("/odometry", "yaw_hat", lambda m: 2 * np.arctan2(m.pose.pose.orientation.z, m.pose.pose.orientation.w)),
        ("/odometry", "p_xy", lambda m: m.pose.covariance[6]),
        ("/odometry", "p_yaw", lambda m: m.pose.covariance[35]),
        ("/ground_truth/odom", "rear_y", lambda m: m.pose.pose.position.y),
        ("/ground_truth/odom", "speed", lambda m: m.twist.twist.linear.x),
        ("/ground_truth/odom", "yaw_rate", lambda m: m.twist.twist.angular.z),
        ("/imu/data", "gyro", lambda m: m.angular_velocity.z),
        ("/imu/data", "imu_force_y", lambda m: m.linear_acceleration.y),
        ("/joint_states", "steer_measured", lambda m: m.position[m.name.index("steering")]),
        ("/tf", "rear_x", lambda m: m.transforms[0].transform.translation.x),
    ],
)
def test_message_values_equal_the_log(read, log, topic, column, value):
    np.testing.assert_allclose([value(message) for _, message in read[topic]], log.column(column), rtol=0, atol=1e-12)


def test_latched_topics_are_repeated_every_five_seconds(tmp_path):
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap is not installed (pip install agrobot-mj[mcap])")
    long = run(load_scenario("straight_line", {"duration_s": 11.0, "plant.kind": "bicycle"}))
    write_mcap(long.scenario, long.signals, tmp_path / "run.mcap")
    found = {"/path": [], "/tf_static": []}
    for each in reader.read_ros2_messages(str(tmp_path / "run.mcap"), topics=list(found)):
        found[each.channel.topic].append(((each.log_time_ns - EPOCH_NS) / 1e9, each.ros_msg))
    assert [[t for t, _ in each] for each in found.values()] == [[0.0, 5.0, 10.0]] * 2
    (antenna,) = found["/tf_static"][0][1].transforms
    assert (antenna.header.frame_id, antenna.child_frame_id) == ("base_link", "gnss")
    assert antenna.transform.translation.z == pytest.approx(long.scenario.tractor.antenna_height_m)


def test_time_stamps_include_the_waiting_time_for_the_external_program(log, tmp_path):
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap is not installed (pip install agrobot-mj[mcap])")
    write_log(log, tmp_path)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    for waited, ros2 in ((1.35, {"waited_s": 1.35}), (0.0, {"waited_s": "long"}), (0.0, {})):
        (tmp_path / "metrics.json").write_text(json.dumps(metrics | {"ros2": ros2}))
        file, _ = export_run(tmp_path)
        first = next(reader.read_ros2_messages(str(file), topics=["/clock"]))
        clock = first.ros_msg.clock
        assert first.log_time_ns == clock.sec * 10**9 + clock.nanosec == EPOCH_NS + round(waited * 1e9)


def test_lost_fix_is_marked_in_the_fix_message(read, log):
    status = np.array([message.status.status for _, message in read["/fix"]])
    np.testing.assert_array_equal(status == -1, log.column("gnss_quality") == 0)
    assert (status == -1).sum() == 20
    assert all(np.isnan(message.latitude) == (message.status.status == -1) for _, message in read["/fix"])


def test_mcap_file_contains_metadata_and_message_definitions(log, tmp_path):
    library = pytest.importorskip("mcap.reader", reason="mcap is not installed (pip install agrobot-mj[mcap])")
    write_mcap(log.scenario, log.signals, tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as stream:
        reader = library.make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        (about,) = reader.iter_metadata()
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert about.metadata["identity"] == log.metrics["identity"]


def test_results_folder_of_a_run_is_exported_as_mcap(log, tmp_path):
    pytest.importorskip("mcap", reason="mcap is not installed (pip install agrobot-mj[mcap])")
    write_log(log, tmp_path / "run")
    file, count = export_run(tmp_path / "run")
    assert file == tmp_path / "run" / "run.mcap"
    assert count == 60 * 7 + 2
    again, _ = export_run(tmp_path / "run", tmp_path / "mine.mcap")
    assert again.read_bytes() == file.read_bytes()


def test_export_of_a_folder_without_a_run_is_reported(tmp_path):
    with pytest.raises(ScenarioError, match=r"the folder has no scenario.toml; specify the folder of a run"):
        export_run(tmp_path)


def test_signals_file_in_the_wrong_format_is_reported(log, tmp_path):
    write_log(log, tmp_path)
    (tmp_path / "signals.parquet").write_text("x\n1\n")
    with pytest.raises(ScenarioError, match=r"signals\.parquet: the file is not the Parquet file of a run"):
        export_run(tmp_path)


def test_error_for_a_missing_extra_gives_the_install_command(log, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap_ros2.writer", None)
    with pytest.raises(ScenarioError, match=r'export --mcap needs mcap_ros2; pip install "agrobot-mj\[mcap\]"'):
        write_mcap(log.scenario, log.signals, tmp_path / "run.mcap")
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(ScenarioError, match=r'ros2 needs rclpy; pip install "agrobot-mj\[ros\]"'):
        import_extra("rclpy", "ros", "ros2")


@pytest.mark.parametrize(
    ("column", "values", "words"),
    [
        ("x_hat_of_nothing", None, ""),
        ("yaw", lambda n: ["x"] * n, "'yaw' contains"),
        ("yaw", lambda n: [1e12] * n, "'yaw' is 1e.12 in row 1"),
        ("t", lambda n: pa.array(range(n), pa.timestamp("ms")), ""),
        ("t", lambda n: pa.nulls(n, pa.float64()), "'t' is not a number in row 1"),
        ("gnss_quality", lambda n: pa.nulls(n, pa.float64()), ""),
        ("t", lambda n: [None] * n, "'t' is empty in every row"),
        ("gnss_quality", lambda n: [None] * n, ""),
    ],
)
def test_error_for_a_damaged_run_names_the_column(log, tmp_path, column, values, words):
    pytest.importorskip("mcap", reason="mcap is not installed (pip install agrobot-mj[mcap])")
    write_log(log, tmp_path)
    if values:
        at = log.signals.column_names.index(column)
        table = log.signals.set_column(at, column, pa.array(values(len(log.signals))))
        pq.write_table(table, tmp_path / "signals.parquet")
    if not words:
        assert export_run(tmp_path)[1] == 60 * 7 + 2
        return
    with pytest.raises(ScenarioError, match=words):
        export_run(tmp_path)


def test_export_overwrites_only_its_own_files(call, log, tmp_path):
    pytest.importorskip("mcap", reason="mcap is not installed (pip install agrobot-mj[mcap])")
    write_log(log, tmp_path / "run")
    arguments = ("export", "run", "--mcap", "--out")
    assert [call(*arguments, "ours")[0] for _ in range(2)] == [0, 0]
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs/run.mcap").write_bytes(b"mine")
    status, _, err = call(*arguments, "theirs")
    assert (status, err.count("\n")) == (2, 1)
    assert (tmp_path / "theirs/run.mcap").read_bytes() == b"mine"


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("", "an argument is blank"),
        ("a.mcap", "--out a.mcap: specify a folder; run.mcap is written into it\n"),
        ("file", "is a file"),
    ],
)
def test_export_accepts_an_output_folder_and_rejects_a_file(call, log, tmp_path, out, words):
    (tmp_path / "file").touch()
    write_log(log, tmp_path / "run")
    status, said, err = call("export", "run", "--mcap", "--out", out)
    assert (status, said) == (2, "")
    assert "--out" in err
    assert words in err
    assert not list(tmp_path.rglob("*.mcap"))
