"""Recorded drives for the evaluation of estimators.

A drive consists of the true states of a run. To evaluate an estimator, sensors with other seeds measure these states
again, at a tenth of the computing time of a run. Gyro, wheel speed and inertial unit are enabled, with the errors in
`SENSORS`.
"""

import time
from collections.abc import Callable
from math import degrees, nan
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import NOMINAL, TICK_S, Array, Conditions, Estimate, Quality, Truth
from agrobot_mj.scenario import Scenario, load_scenario
from agrobot_mj.simulation.loop import Loop

SENSORS: dict[str, Any] = {f"sensors.{name}.enabled": True for name in ("gyro", "wheel_speed", "imu")}
SENSORS["sensors.gyro.bias_deg_s"] = 0.5  # Sensors in all cases. The gyro bias is typical of a cold MEMS unit.
BEGIN_S, DURATION_S = 20.0, 120.0  # Time from which errors are evaluated, and duration of a drive [s]
FULL, BIAS, PAPER, UKF = ({"kind": kind} for kind in ("ekf_full", "ekf_bias", "ekf", "ukf"))
TILT = {"terrain_compensation": True}
SLOPE = {"terrain": {"kind": "slope", "grade_deg": 10.0, "direction_deg": 90.0}}
Day = Callable[[float], Conditions]  # Function that returns the conditions for a time [s]


class RecordedDrive(NamedTuple):
    """True states of a run at each tick, with the scenario that defines sensors and tractor."""

    scenario: Scenario
    truths: list[Truth]


class ErrorTrace(NamedTuple):
    """Errors (estimate - truth) and reported standard deviations of an estimator at each tick of a replay."""

    t: Array
    east: Array  # East error of the position of R [m]
    north: Array
    heading: Array  # Heading error [rad]
    course: Array  # Estimated yaw minus the direction of motion of R [rad]
    yaw_rate: Array  # Yaw-rate error [rad/s]
    nees: Array  # Normalised error squared of the position [-]
    heading_nees: Array
    sigma: Array  # Reported standard deviation of R over both axes [m]
    nis: Array  # Normalised innovation squared of the position [-], NaN without a fix
    aligned: Array  # 1 after the initialisation of the yaw
    travelled: Array  # Distance since the start [m]
    cost: float  # Median time of an update [s]

    @property
    def position(self) -> Array:
        """Distance between the estimated and the true position of R [m]."""
        return np.hypot(self.east, self.north)


def record(name: str, overrides: dict[str, Any], duration: float = DURATION_S) -> RecordedDrive:
    loop, truths = Loop(load_scenario(name, {**SENSORS, **overrides, "duration_s": duration})), []
    for _ in range(loop.scenario.ticks):
        truths.append(loop.truth)
        loop.advance(loop.tick().drive)
    return RecordedDrive(loop.scenario, truths)


def nominal(t: float) -> Conditions:
    return NOMINAL


def follow(
    drive: RecordedDrive, estimator: dict[str, Any], seed: int, day: Day = nominal, yaw_error: float = 0.0
) -> ErrorTrace:
    """Replay a drive with the sensor seed `seed`, and return the errors of an estimator. `yaw_error` is the error of
    the initial heading [rad]."""
    s = drive.scenario.changed({"estimator": estimator})
    first = drive.truths[0]
    sensing = s.sensors.init(seed)
    state: Any = s.estimator.init(first.rear_x, first.rear_y, first.yaw + yaw_error, s.tractor)
    estimates, costs = [], []
    for truth in drive.truths:
        sensing, measured = s.sensors.measure(sensing, truth, day(truth.t), TICK_S)
        began = time.perf_counter()
        state, estimate = s.estimator.update(state, measured, TICK_S)
        costs.append(time.perf_counter() - began)
        estimates.append(estimate)
    return _trace(drive.truths, estimates, float(np.median(costs)))


def _trace(truths: list[Truth], estimates: list[Estimate], cost: float) -> ErrorTrace:
    def true(name: str) -> Array:
        return np.array([getattr(t, name) for t in truths])

    def believed(name: str) -> Array:
        return np.array([getattr(e, name) for e in estimates])

    v_x, v_y = np.gradient(true("rear_x")), np.gradient(true("rear_y"))
    error = np.stack([believed(name) - true(name) for name in ("rear_x", "rear_y")], axis=1)
    P, heading = believed("covariance"), wrap(believed("yaw") - believed("sideslip") - true("yaw"))
    return ErrorTrace(
        t=true("t"),
        east=error[:, 0],
        north=error[:, 1],
        heading=heading,
        course=wrap(believed("yaw") - np.arctan2(v_y, v_x)),
        yaw_rate=believed("yaw_rate") - true("yaw_rate"),
        nees=np.array([d @ np.linalg.solve(p, d) for d, p in zip(error, P[:, :2, :2], strict=True)]),
        heading_nees=heading**2 / P[:, 2, 2],
        sigma=np.sqrt(P[:, 0, 0] + P[:, 1, 1]),
        nis=believed("nis"),
        aligned=believed("aligned").astype(float),
        travelled=np.cumsum(np.hypot(v_x, v_y)),
        cost=cost,
    )


def loss(start: float, seconds: float) -> Day:
    """Return conditions as a function of time, with a GNSS outage of `seconds` [s] from the time `start` [s]."""
    lost = NOMINAL._replace(gnss_quality=Quality.NONE)
    return lambda t: lost if start <= t + 1e-6 < start + seconds else NOMINAL


def outlier(at: float, metres: float) -> Day:
    """Return conditions as a function of time, with a position outlier of `metres` to the east at the time `at` [s]."""
    off = NOMINAL._replace(gnss_offset=(metres, 0.0))
    return lambda t: off if abs(t - at) < 0.5 * TICK_S else NOMINAL


def late(seconds: float) -> Day:
    """Return conditions as a function of time, with an additional GNSS latency of `seconds` [s]."""
    return lambda t: NOMINAL._replace(gnss_latency_s=seconds)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


class Whole(NamedTuple):
    """Results of a replay after `BEGIN_S`: RMS errors, mean NEES and NIS [-], and computing time of an update [us]."""

    position: float  # RMS position error [cm]
    heading: float  # RMS heading error [deg]
    course: float  # RMS course error [deg]
    yaw_rate: float  # RMS yaw-rate error [deg/s]
    nees: float
    nis: float
    cost_us: float
    heading_nees: float


class End(NamedTuple):
    """Errors at the last tick of an outage: position of R and its reported standard deviation [cm], and NEES [-]."""

    position: float
    stated: float
    nees: float
    heading_nees: float


def whole(trace: ErrorTrace) -> Whole:
    counts = trace.t > BEGIN_S
    angles = (degrees(rms(values[counts])) for values in (trace.heading, trace.course, trace.yaw_rate))
    nees, nis, heading_nees = (float(np.nanmean(v[counts])) for v in (trace.nees, trace.nis, trace.heading_nees))
    return Whole(100 * rms(trace.position[counts]), *angles, nees, nis, 1e6 * trace.cost, heading_nees)


def end(trace: ErrorTrace, time: float) -> End:
    """Return the errors at the last tick of an outage that ends at `time` [s]."""
    k = int(np.flatnonzero(trace.t < time - 1e-6)[-1])
    return End(*map(float, (100 * trace.position[k], 100 * trace.sigma[k], trace.nees[k], trace.heading_nees[k])))


def alignment(trace: ErrorTrace) -> tuple[float, float]:
    """Return the distance travelled until the yaw is initialised [m], and the heading error after 5 m [deg]."""
    found = np.flatnonzero(trace.aligned)
    there = int(np.argmax(trace.travelled >= 5.0))
    return (float(trace.travelled[found[0]]) if found.size else nan), abs(degrees(trace.heading[there]))
