"""Recorded drives, and estimators that follow them.

A drive is the truth of a run, recorded once. Sensors with other seeds measure it again and an estimator follows, at a
tenth of the cost of the run. Gyro, wheel speed and inertial unit are on, with the errors of `SENSORS`.
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

SENSORS = {
    "sensors.gyro.enabled": True,
    "sensors.gyro.bias_deg_s": 0.5,
    "sensors.wheel_speed.enabled": True,
    "sensors.imu.enabled": True,
}
"""Sensors of all cases; the gyro's bias is that of a cold MEMS unit."""
BEGIN_S = 20.0
"""Time before which nothing counts [s]."""
DURATION_S = 120.0
"""Length of a drive [s]."""

Day = Callable[[float], Conditions]
"""Conditions at a time [s]."""


class RecordedDrive(NamedTuple):
    """What a tractor did, and the scenario that says how it is measured."""

    scenario: Scenario
    """Scenario of the run; sensors and tractor count."""
    truths: list[Truth]
    """Truth at each tick."""


class ErrorTrace(NamedTuple):
    """Errors of an estimator along a drive, one value per tick."""

    t: Array
    """Time [s]."""
    east: Array
    """Estimated less true R, east [m]."""
    north: Array
    """Estimated less true R, north [m]."""
    heading: Array
    """Estimated less true heading [rad]."""
    course: Array
    """Estimated course less true direction of motion of R [rad]."""
    yaw_rate: Array
    """Estimated less true yaw rate [rad/s]."""
    nees: Array
    """Normalised squared error of the position [-]."""
    heading_nees: Array
    """Squared error of the heading over its stated variance [-]."""
    sigma: Array
    """Stated standard deviation of R, both axes together [m]."""
    nis: Array
    """NIS of the position, NaN without a fix [-]."""
    aligned: Array
    """1 where the yaw has been found."""
    travelled: Array
    """Distance since the start [m]."""
    cost: float
    """Median time of an update [s]."""

    @property
    def position(self) -> Array:
        """Distance of the estimated from the true R [m]."""
        return np.hypot(self.east, self.north)


def record(name: str, overrides: dict[str, Any], duration: float = DURATION_S) -> RecordedDrive:
    """Run a scenario and keep the truth."""
    loop, truths = Loop(load_scenario(name, {**SENSORS, **overrides, "duration_s": duration})), []
    for _ in range(loop.scenario.ticks):
        truths.append(loop.truth)
        loop.advance(loop.tick().drive)
    return RecordedDrive(loop.scenario, truths)


def follow(
    drive: RecordedDrive, estimator: dict[str, Any], seed: int, day: Day | None = None, yaw_error: float = 0.0
) -> ErrorTrace:
    """An estimator on a drive, measured with `seed`; it is told a start heading off by `yaw_error` [rad]."""
    s = drive.scenario.changed({"estimator": estimator})
    first = drive.truths[0]
    sensing = s.sensors.init(seed)
    state: Any = s.estimator.init(first.rear_x, first.rear_y, first.yaw + yaw_error, s.tractor)
    estimates, costs = [], []
    for truth in drive.truths:
        sensing, measured = s.sensors.measure(sensing, truth, day(truth.t) if day else NOMINAL, TICK_S)
        began = time.perf_counter()
        state, estimate = s.estimator.update(state, measured, TICK_S)
        costs.append(time.perf_counter() - began)
        estimates.append(estimate)
    return _trace(drive.truths, estimates, float(np.median(costs)))


def _trace(truths: list[Truth], estimates: list[Estimate], cost: float) -> ErrorTrace:
    x, y = (np.array([getattr(t, name) for t in truths]) for name in ("rear_x", "rear_y"))
    v_x, v_y = np.gradient(x), np.gradient(y)
    error = np.array([(e.rear_x - t.rear_x, e.rear_y - t.rear_y) for t, e in zip(truths, estimates, strict=True)])
    squares = [d @ np.linalg.solve(e.covariance[:2, :2], d) for d, e in zip(error, estimates, strict=True)]
    yaw = np.array([e.yaw for e in estimates])
    sideslip = np.array([e.sideslip for e in estimates])
    heading = wrapped(yaw - sideslip - np.array([t.yaw for t in truths]))
    return ErrorTrace(
        t=np.array([t.t for t in truths]),
        east=error[:, 0],
        north=error[:, 1],
        heading=heading,
        course=wrapped(yaw - np.arctan2(v_y, v_x)),
        yaw_rate=np.array([e.yaw_rate - t.yaw_rate for t, e in zip(truths, estimates, strict=True)]),
        nees=np.array(squares),
        heading_nees=heading**2 / np.array([e.covariance[2, 2] for e in estimates]),
        sigma=np.sqrt([np.trace(e.covariance[:2, :2]) for e in estimates]),
        nis=np.array([e.nis for e in estimates]),
        aligned=np.array([float(e.aligned) for e in estimates]),
        travelled=np.cumsum(np.hypot(v_x, v_y)),
        cost=cost,
    )


def nominal(t: float) -> Conditions:
    """No faults."""
    return NOMINAL


def loss(start: float, seconds: float) -> Day:
    """No solution for some time."""
    lost = NOMINAL._replace(gnss_quality=Quality.NONE)
    return lambda t: lost if start <= t + 1e-6 < start + seconds else NOMINAL


def outlier(at: float, metres: float) -> Day:
    """One fix off to the east."""
    off = NOMINAL._replace(gnss_offset=(metres, 0.0))
    return lambda t: off if abs(t - at) < 0.5 * TICK_S else NOMINAL


def late(seconds: float) -> Day:
    """All fixes late."""
    day = NOMINAL._replace(gnss_latency_s=seconds)
    return lambda t: day


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def settled(trace: ErrorTrace) -> list[float]:
    """Position [cm], heading, course [deg], yaw rate [deg/s], NEES, NIS and cost of an update [us], after `BEGIN_S`."""
    counts = trace.t > BEGIN_S
    return [
        100 * rms(trace.position[counts]),
        *(degrees(rms(values[counts])) for values in (trace.heading, trace.course, trace.yaw_rate)),
        float(np.mean(trace.nees[counts])),
        float(np.nanmean(trace.nis[counts])),
        1e6 * trace.cost,
    ]


def coasted(trace: ErrorTrace, end: float) -> float:
    """Error of R at the last tick of a loss that ends at `end` [cm]."""
    return 100 * float(trace.position[np.flatnonzero(trace.t < end - 1e-6)[-1]])


def alignment(trace: ErrorTrace) -> tuple[float, float]:
    """Distance travelled until the yaw was found [m], and error of the heading after 5 m [deg]."""
    found = np.flatnonzero(trace.aligned)
    there = int(np.argmax(trace.travelled >= 5.0))
    return (float(trace.travelled[found[0]]) if found.size else nan), abs(degrees(trace.heading[there]))


def wrapped(angles: Array) -> Array:
    return np.array([wrap(angle) for angle in angles.tolist()])


FULL, BIAS, PAPER = {"kind": "ekf_full"}, {"kind": "ekf_bias"}, {"kind": "ekf"}
TILT = {"terrain_compensation": True}
SLOPE = {"terrain": {"kind": "slope", "grade_deg": 10.0, "direction_deg": 90.0}}
