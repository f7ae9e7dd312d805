"""ROS 2 messages of one tick as plain data: dictionaries with the fields that are defined in `definitions`.

Frames follow REP 103 and REP 105. `map` has axes east, north and up, and the origin of the scenario. `base_link` is R,
the point on the ground below the rear axle, with x forward and y left. Time stamps count from a fixed UTC time, so that
runs are repeatable. A covariance that starts with -1 marks a quantity that is not measured, as usual in ROS.

A recording contains the same messages that a live subscriber receives.
"""

from collections import namedtuple
from collections.abc import Iterator
from math import cos, isfinite, isnan, nan, radians, sin
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.core.nmea import START
from agrobot_mj.core.signals import TICK_S, Quality
from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps
from agrobot_mj.extensions.links.cmd_vel import CmdVel
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.stepping import Simulation

TickSample = namedtuple(
    "TickSample",
    "t gnss_x gnss_y gnss_quality imu_roll imu_pitch gyro steer_measured wheel_speed "
    "rear_x_hat rear_y_hat yaw_hat speed_hat yaw_rate_hat p_xx p_xy p_yy p_yaw "
    "rear_x rear_y z yaw pitch roll speed lateral_speed yaw_rate "
    "imu_force_x imu_force_y imu_force_z cmd_speed cmd_yaw_rate cmd_age",
    defaults=(nan, nan, nan, nan, nan, nan),
)
"""Signals of one tick, with names and units as in the log. Missing signals are NaN."""


def sample_of(sim: Simulation) -> TickSample:
    """Return the signals of the current tick of a running simulation."""
    m, e, truth = sim.measurement, sim.estimate, sim.truth
    fix = (m.fix.x, m.fix.y) if m.fix else (nan, nan)
    p = e.covariance
    return TickSample(
        *(truth.t, *fix, float(m.quality if m.fix else Quality.NONE), m.roll, m.pitch, m.gyro, m.steer, m.wheel_speed),
        *(e.rear_x, e.rear_y, e.yaw, e.speed, e.yaw_rate),
        *(float(p[0, 0]), float(p[0, 1]), float(p[1, 1]), float(p[2, 2])),
        *(truth.rear_x, truth.rear_y, truth.z, truth.yaw, truth.pitch, truth.roll),
        *(truth.speed, truth.lateral_speed, truth.yaw_rate),
        *m.readings["imu"][2:],
    )


def samples_of(signals: pa.Table) -> Iterator[TickSample]:
    """Yield the signals of each tick from the table `signals.parquet`."""
    known = set(signals.column_names)
    columns = [
        signals[name].to_numpy() if name in known else np.full(len(signals), np.nan) for name in TickSample._fields
    ]
    quality = TickSample._fields.index("gnss_quality")
    columns[quality] = np.nan_to_num(columns[quality], nan=Quality.NONE)  # the run may have diverged in the first tick
    return (TickSample(*row) for row in np.column_stack(columns).astype(float).tolist())


Content = dict[str, Any]
EPOCH_NS = round(START.timestamp() * 1e9)  # Time at the start of every run, in nanoseconds since 1970 (UTC)
NO_FIX, PLAIN_FIX, GROUND_FIX = -1, 0, 2
STATUS = {Quality.DGPS: PLAIN_FIX, Quality.FLOAT: PLAIN_FIX, Quality.FIX: GROUND_FIX}
"""NavSatStatus for each solution quality: plain fix for RTK float, ground-based augmentation for RTK fixed."""
SERVICES = 1 + 2 + 4 + 8  # Bit mask of satellite systems: GPS, GLONASS, BeiDou, Galileo
UP_SIGMA = 2.0
"""Standard deviation of the receiver height divided by the horizontal standard deviation [-]. Assumed value (range
1.5-3)."""
AGAIN_TICKS = 100  # Number of ticks between repetitions of /path and /tf_static, for subscribers that connect later
PATH_STEP_M, MOST_PATH_POINTS = 0.5, 2000  # Distance between points of /path [m], and maximum number of points [-]
UNKNOWN_VARIANCE = 1e6  # Variance that marks a component without measurement
NOT_MEASURED = [-1.0, *[0.0] * 8]  # Covariance that marks an unmeasured quantity


class Site(NamedTuple):
    """Scenario values from which messages are computed: geographic origin, geometry and sensor noise."""

    origin: Origin
    antenna: tuple[float, float, float]  # Position of the antenna in `base_link`: ahead, to the left and up [m]
    cg_height: float  # Height of the CG above the ground [m]
    cg_to_rear_axle: float  # Distance of the CG from the rear axle [m]
    wheel_radius: float  # Radius of the rear wheels [m]
    position_variance: tuple[float, float]
    """Variances of a horizontal position coordinate for the solutions RTK float and RTK fixed [m2]."""
    tilt_variance: float  # Variance of roll and pitch of the inertial unit [rad2]
    gyro_variance: float  # Variance of the gyro noise [rad2/s2]
    gyro_walk: float  # Growth rate of the variance of the gyro bias, a random walk [rad2/s3]


def site_of(scenario: Scenario) -> Site:
    """Return the `Site` of a scenario. The geographic origin comes from the guidance or is the default origin."""
    tractor, sensors = scenario.tractor, scenario.sensors
    keys = scenario.guidance if isinstance(scenario.guidance, CmdVel | AgOpenGps) else CmdVel()
    gnss, imu, gyro = sensors.gnss, sensors.imu, sensors.gyro
    return Site(
        Origin(keys.origin_lat_deg, keys.origin_lon_deg),
        tractor.antenna,
        tractor.cg_height_m,
        tractor.cg_to_rear_axle,
        tractor.rear_wheel_radius_m,
        (gnss.float_sigma_m**2, gnss.sigma_m**2),
        radians(imu.sigma_deg) ** 2 + radians(imu.wander_sigma_deg) ** 2,
        radians(gyro.sigma_deg_s) ** 2,
        radians(gyro.bias_walk_deg_s_rt_s) ** 2,
    )


def messages(s: TickSample, site: Site, yaw: float, time: float | None = None) -> list[tuple[str, Content]]:
    """Return pairs of topic and message for a tick, ending with /clock. `yaw` is the inertial unit's heading [rad]."""
    at = stamp(s.t if time is None else time)
    found = [("/fix", fix(s, site, at)), ("/joint_states", joint_states(s, site, at))]
    if isfinite(s.gyro) or isfinite(s.imu_roll):
        found.append(("/imu/data", imu(s, site, yaw, at)))
    found += [("/odometry", odometry_message(s, at)), ("/ground_truth/odom", true(s, site, at))]
    return [*found, ("/clock", {"clock": at})]


def stamp(t: float) -> Content:
    """Return `builtin_interfaces/Time` for the time `t` since the start [s]."""
    sec, nanosec = divmod(nanoseconds(t), 1_000_000_000)
    return {"sec": sec, "nanosec": nanosec}


def nanoseconds(t: float) -> int:
    """Return the UTC time at `t` seconds after the start [ns since 1970], rounded to microseconds."""
    return EPOCH_NS + round(t * 1e6) * 1000


def header(at: Content, frame: str) -> Content:
    """Return `std_msgs/Header` with a time stamp and a frame."""
    return {"stamp": at, "frame_id": frame}


def fix(s: TickSample, site: Site, at: Content) -> Content:
    """Return `sensor_msgs/NavSatFix` of the antenna. The altitude has no noise and ignores the tilt of the tractor."""
    status = STATUS.get(round(s.gnss_quality), NO_FIX)
    if isnan(s.gnss_x):
        status, (latitude, longitude), variance = NO_FIX, (nan, nan), 0.0
    else:
        latitude, longitude = to_geodetic(site.origin, s.gnss_x, s.gnss_y)
        variance = site.position_variance[status == GROUND_FIX]
    return {
        "header": header(at, "gnss"),
        "status": {"status": status, "service": SERVICES},
        "latitude": latitude,
        "longitude": longitude,
        "altitude": s.z + site.antenna[2] - site.cg_height if status != NO_FIX else nan,
        "position_covariance": _diagonal(variance, variance, UP_SIGMA**2 * variance),
        "position_covariance_type": 2 if status != NO_FIX else 0,
    }


def imu(s: TickSample, site: Site, yaw: float, at: Content) -> Content:
    """Return `sensor_msgs/Imu`: attitude, yaw rate, and noise-free specific force."""
    attitude = [0.0 if isnan(angle) else angle for angle in (s.imu_roll, s.imu_pitch, yaw)]
    tilt = UNKNOWN_VARIANCE if isnan(s.imu_roll) else site.tilt_variance
    drift = site.gyro_variance * TICK_S * s.t + site.gyro_walk * s.t**3 / 3
    around = UNKNOWN_VARIANCE if isnan(yaw) else drift
    force = s.imu_force_x, s.imu_force_y, s.imu_force_z
    return {
        "header": header(at, "base_link"),
        "orientation": quaternion(*attitude),
        "orientation_covariance": _diagonal(tilt, tilt, around),
        "angular_velocity": vector(0.0, 0.0, 0.0 if isnan(s.gyro) else s.gyro),
        "angular_velocity_covariance": _diagonal(
            UNKNOWN_VARIANCE, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE if isnan(s.gyro) else site.gyro_variance
        ),
        "linear_acceleration": vector(0.0, 0.0, 0.0) if isnan(s.imu_force_x) else vector(*force),
        "linear_acceleration_covariance": NOT_MEASURED if isnan(s.imu_force_x) else _diagonal(0.0, 0.0, 0.0),
    }


def joint_states(s: TickSample, site: Site, at: Content) -> Content:
    """Return `sensor_msgs/JointState` with the measured steering angle and, if measured, the speed of the rear
    wheels."""
    spin = [] if isnan(s.wheel_speed) else [s.wheel_speed / site.wheel_radius]
    return {
        "header": header(at, ""),
        "name": ["steering", *(["rear_wheels"] if spin else [])],
        "position": [s.steer_measured, *([nan] if spin else [])],
        "velocity": [nan, *spin] if spin else [],
        "effort": [],
    }


def odometry_message(s: TickSample, at: Content) -> Content:
    """Return `nav_msgs/Odometry` of the estimated motion of the rear-axle point R in the map plane."""
    covariance = [0.0] * 36
    covariance[0], covariance[1], covariance[6], covariance[7] = s.p_xx, s.p_xy, s.p_xy, s.p_yy
    covariance[35] = s.p_yaw
    pose = {"position": vector(s.rear_x_hat, s.rear_y_hat, 0.0), "orientation": quaternion(0.0, 0.0, s.yaw_hat)}
    return _odometry(at, pose, covariance, vector(s.speed_hat, 0.0, 0.0), vector(0.0, 0.0, s.yaw_rate_hat))


def true(s: TickSample, site: Site, at: Content) -> Content:
    """Return `nav_msgs/Odometry` of the true motion of the rear-axle point R in the map, with velocities ahead and to
    the left."""
    up = s.z - site.cg_height
    pose = {"position": vector(s.rear_x, s.rear_y, up), "orientation": quaternion(s.roll, s.pitch, s.yaw)}
    left = s.lateral_speed - site.cg_to_rear_axle * s.yaw_rate
    return _odometry(at, pose, [0.0] * 36, vector(s.speed, left, 0.0), vector(0.0, 0.0, s.yaw_rate))


def frames(s: TickSample, site: Site, at: Content) -> Content:
    """Return `tf2_msgs/TFMessage` with the true pose of `base_link` in `map`."""
    place = vector(s.rear_x, s.rear_y, s.z - site.cg_height)
    return {"transforms": [_transform(at, "map", "base_link", place, quaternion(s.roll, s.pitch, s.yaw))]}


def fixed_frames(site: Site, at: Content) -> Content:
    """Return `tf2_msgs/TFMessage` with the position of the antenna frame `gnss` in `base_link`."""
    return {"transforms": [_transform(at, "base_link", "gnss", vector(*site.antenna), quaternion(0.0, 0.0, 0.0))]}


def request(s: TickSample) -> Content:
    """Return `geometry_msgs/Twist` with the velocity command received in a tick."""
    return {"linear": vector(s.cmd_speed, 0.0, 0.0), "angular": vector(0.0, 0.0, s.cmd_yaw_rate)}


def path(scenario: Scenario) -> Content:
    """Return `nav_msgs/Path` with the reference path of the CG."""
    end = max(scenario.ticks * TICK_S, scenario.path.duration_s)
    count = int(np.clip(end * scenario.path.speed_m_s / PATH_STEP_M, 2, MOST_PATH_POINTS))
    at = header(stamp(0.0), "map")
    points = [scenario.path.at(time) for time in np.linspace(0.0, end, count).tolist()]
    poses = [{"position": vector(r.x, r.y, 0.0), "orientation": quaternion(0.0, 0.0, r.yaw)} for r in points]
    return {"header": at, "poses": [{"header": at, "pose": pose} for pose in poses]}


def vector(x: float, y: float, z: float) -> Content:
    """Return the fields of `geometry_msgs/Vector3` or `geometry_msgs/Point`."""
    return {"x": x, "y": y, "z": z}


def quaternion(roll: float, pitch: float, yaw: float) -> Content:
    """Return `geometry_msgs/Quaternion` for rotations about the map axes x, then y, then z [rad]."""
    (cr, cp, cy), (sr, sp, sy) = ([f(angle / 2) for angle in (roll, pitch, yaw)] for f in (cos, sin))
    return {
        "x": sr * cp * cy - cr * sp * sy,
        "y": cr * sp * cy + sr * cp * sy,
        "z": cr * cp * sy - sr * sp * cy,
        "w": cr * cp * cy + sr * sp * sy,
    }


def _odometry(at: Content, pose: Content, covariance: list[float], linear: Content, angular: Content) -> Content:
    return {
        "header": header(at, "map"),
        "child_frame_id": "base_link",
        "pose": {"pose": pose, "covariance": covariance},
        "twist": {"twist": {"linear": linear, "angular": angular}, "covariance": [0.0] * 36},
    }


def _transform(at: Content, parent: str, child: str, place: Content, turn: Content) -> Content:
    transform = {"translation": place, "rotation": turn}
    return {"header": header(at, parent), "child_frame_id": child, "transform": transform}


def _diagonal(*variances: float) -> list[float]:
    return [float(x) for x in np.diag(variances).ravel()]
