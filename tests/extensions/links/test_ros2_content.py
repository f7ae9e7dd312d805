"""ROS 2 messages as plain data: values, frames and missing measurements, equal in a run and from a log."""

from math import cos, isnan, nan, pi, radians, sin

import numpy as np
import pytest

from agrobot_mj import Simulation, load_scenario
from agrobot_mj.core.geodesy import to_local
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.links.ros2.bag import messages_of
from agrobot_mj.extensions.links.ros2.content import (
    EPOCH_NS,
    fix,
    imu,
    messages,
    path,
    quaternion,
    sample_of,
    site_of,
    stamp,
    true,
)
from agrobot_mj.extensions.links.ros2.definitions import DEFINITIONS, RECORDED, TOPICS, full_definition, full_name
from agrobot_mj.extensions.links.running import gyro_heading

UNIT = {"sensors.imu.enabled": True, "sensors.gyro.enabled": True, "sensors.wheel_speed.enabled": True}
KEYS = {"guidance.kind": "stanley", "duration_s": 3.0, **UNIT}


@pytest.fixture(scope="module")
def drive():
    """Return the live messages of each tick and the log."""
    sim, yaw, live = Simulation("side_slope_10", KEYS), nan, []
    sim.reset()
    site = site_of(sim.scenario)
    while not sim.done:
        sample = sample_of(sim)
        yaw = gyro_heading(yaw, sample.gyro, sample.yaw, TICK_S)
        live.append((sample, messages(sample, site, yaw)))
        sim.step()
    return live, sim.log()


def same(a, b):
    """Return whether two values are equal, where NaN equals NaN."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b or (a != a and b != b)


FRAMES = ("/tf", "/tf_static")  # Topics of a file that no node sends


def test_messages_from_a_log_equal_the_live_messages(drive):
    live, log = drive
    kept = [
        (topic, content) for topic, _, content in messages_of(log.scenario, log.signals, 0.0) if topic not in FRAMES
    ]
    sent = [("/path", path(log.scenario)), *(message for _, each in live for message in each)]
    assert [topic for topic, _ in kept] == [topic for topic, _ in sent]
    assert all(same(a, b) for (_, a), (_, b) in zip(kept, sent, strict=True))


def test_all_topics_of_a_tick_are_published_with_the_clock_last(drive):
    (_, first), *_ = drive[0]
    assert {topic for topic, _ in first} == set(TOPICS) - {"/path"}
    assert first[-1][0] == "/clock"


def test_time_stamps_count_from_a_fixed_epoch():
    assert stamp(0.0) == {"sec": EPOCH_NS // 10**9, "nanosec": 0}
    assert stamp(1.05) == {"sec": EPOCH_NS // 10**9 + 1, "nanosec": 50_000_000}
    assert stamp(0.3 - 0.1) == stamp(0.2), "whole microseconds"


def test_fix_message_contains_the_antenna_position(drive):
    live, log = drive
    (sample, sent), site = live[20], site_of(log.scenario)
    content = dict(sent)["/fix"]
    assert to_local(site.origin, content["latitude"], content["longitude"]) == pytest.approx(
        (sample.gnss_x, sample.gnss_y), abs=1e-6
    )
    assert content["status"]["status"] == 2
    assert content["position_covariance"][0] == log.scenario.sensors.gnss.sigma_m**2
    t = log.scenario.tractor
    assert content["altitude"] == pytest.approx(sample.z + t.antenna_height_m - t.cg_height_m)


def test_fix_quality_determines_status_and_covariance_of_the_message(drive):
    (sample, _), site = drive[0][0], site_of(load_scenario("straight_line"))
    floating = fix(sample._replace(gnss_quality=1.0), site, stamp(0))
    assert floating["status"]["status"] == 0
    assert floating["position_covariance"][0] == pytest.approx(0.3**2)
    lost = fix(sample._replace(gnss_quality=0.0, gnss_x=nan, gnss_y=nan), site, stamp(0))
    assert lost["status"]["status"] == -1
    assert isnan(lost["latitude"])
    assert lost["position_covariance_type"] == 0


def rotated(q, v):
    """Return the vector `v` rotated by the quaternion `q`."""
    u, w = np.array([q["x"], q["y"], q["z"]]), q["w"]
    return v + 2 * np.cross(u, np.cross(u, v) + w * np.asarray(v))


def test_attitude_message_uses_forward_left_up_axes():
    yaw, tilt = 0.7, radians(10)
    forward = rotated(quaternion(0.0, 0.0, yaw), [1.0, 0.0, 0.0])
    np.testing.assert_allclose(forward, [cos(yaw), sin(yaw), 0.0], atol=1e-15)
    assert rotated(quaternion(tilt, 0.0, yaw), [0.0, 1.0, 0.0])[2] == pytest.approx(sin(tilt)), "left side up"
    assert rotated(quaternion(0.0, tilt, yaw), [1.0, 0.0, 0.0])[2] == pytest.approx(-sin(tilt)), "nose down"


def test_true_velocity_message_is_the_derivative_of_true_position(drive):
    live, log = drive
    site, k = site_of(log.scenario), 50
    before, now, after = (live[i][0] for i in (k - 1, k, k + 1))
    twist = true(now, site, stamp(now.t))["twist"]["twist"]["linear"]
    dx, dy = (after.rear_x - before.rear_x) / 0.1, (after.rear_y - before.rear_y) / 0.1
    forward, left = cos(now.yaw) * dx + sin(now.yaw) * dy, -sin(now.yaw) * dx + cos(now.yaw) * dy
    assert (twist["x"], twist["y"]) == pytest.approx((forward, left), abs=0.02)


def test_missing_sensors_are_marked_in_the_messages(drive):
    (sample, _), *_ = drive[0]
    site = site_of(load_scenario("straight_line"))
    assert "/imu/data" not in dict(messages(sample._replace(gyro=nan, imu_roll=nan, imu_pitch=nan), site, nan))
    gyro_alone = imu(sample._replace(imu_roll=nan, imu_pitch=nan), site, 0.1, stamp(0))
    assert gyro_alone["orientation_covariance"][0] == 1e6
    assert imu(sample._replace(imu_force_x=nan), site, 0.1, stamp(0))["linear_acceleration_covariance"][0] == -1


def test_heading_message_contains_the_integral_of_the_gyro():
    turned = [gyro_heading(nan, 0.2, 3.0, TICK_S)]
    for _ in range(100):
        turned.append(gyro_heading(turned[-1], 0.2, 0.0, TICK_S))
    assert turned[0] == 3.0
    assert turned[-1] == pytest.approx(3.0 + 0.2 * 100 * 0.05 - 2 * pi)
    assert isnan(gyro_heading(nan, nan, 3.0, TICK_S))


def test_path_message_contains_the_reference_points():
    scenario = load_scenario("circle")
    points = [pose["pose"]["position"] for pose in path(scenario)["poses"]]
    steps = np.hypot(np.diff([p["x"] for p in points]), np.diff([p["y"] for p in points]))
    assert 0.3 < steps.mean() < 0.6
    start = scenario.path.at(0.0)
    assert (points[0]["x"], points[0]["y"]) == (start.x, start.y)


def test_message_definitions_are_complete_and_match_the_published_fields(drive):
    live, log = drive
    for topic, _, content in messages_of(log.scenario, log.signals, 0.0):
        check(RECORDED[topic], content)
    assert full_name("nav_msgs/Path") == "nav_msgs/msg/Path"
    text = full_definition("nav_msgs/Path")
    assert text.count("MSG: geometry_msgs/Point\n") == 1
    assert text.count("MSG:") == 6


def check(kind, content):
    """Check that a message contains exactly the fields of its type, in order."""
    fields = [line.split() for line in DEFINITIONS[kind].split("\n") if "=" not in line]
    assert list(content) == [name for _, name, *_ in fields], kind
    for inner, name, *_ in fields:
        value, element = content[name], inner.partition("[")[0]
        if element in DEFINITIONS:
            for each in value if inner.endswith("]") else [value]:
                check(element, each)
        elif "[" in inner and not inner.endswith("[]"):
            assert len(value) == int(inner.partition("[")[2][:-1])
