"""Tractor as a ROS 2 node, tested from other processes. Skipped without the environment of `make ros`."""

import ast
import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from agrobot_mj.extensions.links.ros2.definitions import RECORDED, TOPICS

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "examples" / "ros2_follow_path.py"
PYTHON = Path(os.environ.get("AGROBOT_ROS_PYTHON", ROOT / ".venv-ros" / "bin" / "python"))
pytestmark = pytest.mark.skipif(not PYTHON.exists(), reason="no ROS 2 here: `make ros` makes .venv-ros (1.7 GB)")

SUBSCRIBER = """
import json, sys, time
from importlib import import_module
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
topics = json.loads(sys.argv[1])
rclpy.init()
node, seen = rclpy.create_node("listener"), {}
for topic, kind in topics.items():
    package, name = kind.split("/")
    durability = DurabilityPolicy.TRANSIENT_LOCAL if topic == "/path" else DurabilityPolicy.VOLATILE
    def take(message, topic=topic):
        stamp = message.clock if topic == "/clock" else message.header.stamp
        seen.setdefault(topic, []).append(stamp.sec * 10**9 + stamp.nanosec)
    message = getattr(import_module(package + ".msg"), name)
    node.create_subscription(message, topic, take, QoSProfile(depth=100, durability=durability))
end = time.monotonic() + float(sys.argv[2])
while time.monotonic() < end and min(len(seen.get(topic, [])) for topic in topics if topic != "/path") < 40:
    rclpy.spin_once(node, timeout_sec=0.1)
print(json.dumps(seen))
"""
READER = """
import json, sys
from importlib import import_module
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message
last, count = {}, {}
with open(sys.argv[1], "rb") as stream:
    for schema, channel, message in make_reader(stream).iter_messages():
        package, _, name = schema.name.split("/")
        if package == "tf2_msgs":
            continue
        last[channel.topic] = deserialize_message(message.data, getattr(import_module(package + ".msg"), name))
        count[channel.topic] = count.get(channel.topic, 0) + 1
o, f, j = last["/odometry"], last["/fix"], last["/joint_states"]
print(json.dumps({"count": count, "x": o.pose.pose.position.x, "p_xx": o.pose.covariance[0], "frame": o.header.frame_id,
    "child": o.child_frame_id, "status": f.status.status, "latitude": f.latitude, "names": list(j.name),
    "steer": j.position[0], "path": len(last["/path"].poses), "sec": last["/clock"].clock.sec}))
"""

STAMPED = """
import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
rclpy.init()
node, count = rclpy.create_node("stamped"), [0]
out = node.create_publisher(TwistStamped, "/cmd_vel", 10)
def answer(odometry):
    count[0] += 1
    if count[0] % 2 == 0:
        message = TwistStamped()
        message.twist.linear.x, message.twist.angular.z = 1.0, 0.1
        out.publish(message)
node.create_subscription(Odometry, "/odometry", answer, 10)
rclpy.spin(node)
"""


@pytest.fixture
def start(tmp_path):
    """Yield a function that starts a program in the environment of ROS, in a separate domain, until the test ends."""
    running = []
    domain = 100 + os.getpid() % 100
    keep = {key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "RMW_", "FAST"))}
    environment = {**keep, "ROS_DOMAIN_ID": str(domain), "PYTHONPATH": str(ROOT)}

    def begin(*arguments):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        process = subprocess.Popen([PYTHON, *map(str, arguments)], env=environment, cwd=tmp_path, **pipes)
        running.append(process)
        return process

    yield begin
    for process in running:
        process.kill()
        process.communicate()


def tractor(start, *options):
    return start("-m", "agrobot_mj", "ros2", "straight_line", "--no-rrd", "--out", "run", *options)


def result(process, seconds=600):
    out, err = process.communicate(timeout=seconds)
    assert process.returncode == 0, err
    return out


def test_subscriber_in_another_process_receives_all_topics(start):
    listener = start("-c", SUBSCRIBER, json.dumps(TOPICS), "60")
    start(EXAMPLE)
    result(tractor(start, "--duration", "10", "--pace", "real_time"))
    seen = json.loads(result(listener))
    assert set(seen) == set(TOPICS)
    for topic in set(TOPICS) - {"/path"}:
        assert {b - a for a, b in zip(seen[topic], seen[topic][1:], strict=False)} == {50_000_000}, topic


def test_external_controller_follows_a_line_within_10_cm(start, tmp_path):
    assert lines_of_code(EXAMPLE) <= 30
    for name in ("run", "again"):
        follower = start(EXAMPLE)
        options = ("--pace", "lock_step", "--set", "path.speed_m_s=1.5", "--out", name)
        result(tractor(start, *options))
        follower.kill()
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["outcome"] == "completed"
    assert metrics["xte_abs_p95"] < 0.05
    beside = pq.read_table(tmp_path / "run" / "signals.parquet")["y"].to_numpy()
    assert abs(beside).max() < 0.10
    assert beside.std() > 0.001, "it drove, and the sensors are noisy"
    first, second = ((tmp_path / name / "signals.parquet").read_bytes() for name in ("run", "again"))
    assert first == second, "lock-step repeats"


def test_program_may_send_time_stamped_requests_at_10_hz(start, tmp_path):
    start("-c", STAMPED)
    result(tractor(start, "--stamped", "--pace", "lock_step", "--every", "2", "--duration", "2", "--wait", "30"))
    signals = pq.read_table(tmp_path / "run" / "signals.parquet")
    assert set(signals["cmd_speed"].to_pylist()) == {1.0}
    assert set(signals["cmd_yaw_rate"].to_pylist()) == {0.1}
    assert {round(age, 2) for age in signals["cmd_age"].to_pylist()} == {0.0, 0.05}


def test_tractors_in_two_ros_namespaces_are_independent(start, tmp_path):
    start("-c", STAMPED, "--ros-args", "-r", "__ns:=/one", "-r", "/cmd_vel:=cmd_vel", "-r", "/odometry:=odometry")
    options = ("--stamped", "--duration", "2", "--wait", "15")
    other = tractor(start, *options, "--namespace", "field/two", "--out", "other")
    result(tractor(start, *options, "--namespace", "/one"))
    assert set(pq.read_table(tmp_path / "run" / "signals.parquet")["cmd_speed"].drop_null().to_pylist()) == {1.0}
    assert other.wait(timeout=300) == 1
    assert "no message on /field/two/cmd_vel within 15 s" in other.stderr.read()


def lines_of_code(file):
    """Return the number of lines without empty lines, docstrings, comments and imports."""
    text = file.read_text(encoding="utf-8")
    left_out = set()
    for node in ast.walk(ast.parse(text)):
        docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if docstring or isinstance(node, ast.Import | ast.ImportFrom):
            left_out |= set(range(node.lineno, node.end_lineno + 1))
    return sum(
        bool(line.strip()) and not line.lstrip().startswith("#") and number not in left_out
        for number, line in enumerate(text.splitlines(), 1)
    )


def listening(pid):
    """Return the local addresses of all sockets on which a process can receive."""
    found = subprocess.run(["ss", "-H", "-lnptu"], capture_output=True, text=True, check=True).stdout
    return [line.split()[4].rpartition(":")[0] for line in found.splitlines() if f"pid={pid}," in line]


def sockets_of(process):
    """Return the socket addresses as soon as they exist."""
    end = time.monotonic() + 300
    while not (found := listening(process.pid)) and time.monotonic() < end and process.poll() is None:
        time.sleep(0.2)
    time.sleep(1.0)
    return set(listening(process.pid) or found)


@pytest.mark.skipif(shutil.which("ss") is None, reason="looks for sockets with ss")
def test_ros2_link_communicates_only_on_loopback_by_default(start):
    process = tractor(start, "--wait", "60")
    assert sockets_of(process) == {"127.0.0.1"}
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=300) == 1
    asked = tractor(start, "--wait", "60", "--network")
    assert sockets_of(asked) - {"127.0.0.1"}


WITHOUT = {"/path", "/tf", "/tf_static", "/cmd_vel", "/imu/data"}
"""Topics that are missing in the file of a circle or in some ticks, or that the ROS packages cannot read."""


def test_ros_reads_the_mcap_export_of_a_run(start, tmp_path):
    result(start("-m", "agrobot_mj", "run", "circle", "--set", "duration_s=4", "--no-rrd", "-q", "--out", "run"))
    result(start("-m", "agrobot_mj", "export", "run", "--mcap"))
    read = json.loads(result(start("-c", READER, tmp_path / "run" / "run.mcap")))
    signals = pq.read_table(tmp_path / "run" / "signals.parquet")
    last = {name: signals[name].to_numpy()[-1] for name in ("rear_x_hat", "p_xx", "steer_measured", "t")}
    assert read["count"] == {"/path": 1, **dict.fromkeys(set(RECORDED) - WITHOUT, 80)}
    assert (read["x"], read["p_xx"], read["steer"]) == (last["rear_x_hat"], last["p_xx"], last["steer_measured"])
    assert (read["frame"], read["child"], read["status"], read["names"]) == ("map", "base_link", 2, ["steering"])
    assert read["path"] > 50
