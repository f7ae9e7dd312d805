"""Check of a connection: message rates, latency, effective wheelbase, settings of the guidance program and missing
signals."""

from collections.abc import Iterator
from math import tan
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps
from agrobot_mj.metrics.base import rms
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log

CHECK_S = 20.0  # Duration of a check [s]
SURE_M = 0.3  # Maximum half width of the 95 % interval of an identified antenna position [m]. Assumed value.
ANTENNA_ROWS = 10  # Half of the minimum number of GNSS positions for estimating the antenna position [-]
TURNING = 0.02
"""Minimum RMS yaw rate for estimating the wheelbase [rad/s]. Assumed value, reached in bends of 75 m radius at 1.5
m/s."""


def check_lines(scenario: Scenario, log: Log, block: dict[str, Any]) -> Iterator[str]:
    """Yield the results of a connection check as lines of text. `block` contains the metrics of the link."""
    answered, rate = block["answered_fraction"], block["steer_messages_hz"]
    if answered is not None and rate is not None:
        yield f"rate: {rate:.1f} steering messages per second; {100 * answered:.0f} % of the positions were answered"
        yield f"latency: median {block['latency_ms_median']:.1f} ms, 95 % below {block['latency_ms_p95']:.1f} ms"
    yield _wheelbase(scenario, log)
    t = scenario.tractor
    yield f"settings: steering limit {t.steer_limit_deg:g} deg; antenna {t.antenna_height_m:g} m high"
    yield (f"antenna: {t.antenna_ahead_m:g} m ahead of the rear axle, {t.antenna_left_m:g} m left; {_antenna(log)}")
    yield from (f"missing: {line}" for line in _missing(scenario, block))


def _wheelbase(scenario: Scenario, log: Log) -> str:
    """Return a line of text with the effective wheelbase [m], estimated from yaw rate, steering angle and speed."""
    given, rate = scenario.tractor.wheelbase_m, log.column("yaw_rate")
    if (rms(rate) or 0.0) < TURNING:
        return f"wheelbase: {given:g} m; the tractor did not turn, so the yaw rate does not confirm it"
    moved = log.column("speed") * np.vectorize(tan)(log.column("steer"))
    return f"wheelbase: {given:g} m; {float(moved @ rate / (rate @ rate)):.2f} m estimated from the yaw rate"


def _antenna(log: Log) -> str:
    """Return a text with the antenna position ahead and to the left of the rear axle [m], estimated from GNSS
    positions, speed and yaw rate."""
    fixed = np.isfinite(log.column("gnss_x"))
    t, u, rate = (log.column(name) for name in ("t", "speed", "yaw_rate"))
    yaw = log.column("yaw")[0] + cumulative_trapezoid(rate, t, initial=0)
    x, y = (cumulative_trapezoid(u * each, t, initial=0)[fixed] for each in (np.cos(yaw), np.sin(yaw)))
    c, s, one, zero = np.cos(yaw)[fixed], np.sin(yaw)[fixed], np.ones(fixed.sum()), np.zeros(fixed.sum())
    # unknown: antenna ahead and left, start east and north, initial heading, speed
    rows = np.concatenate([np.stack([c, -s, one, zero, -y, x], 1), np.stack([s, c, zero, one, x, y], 1)])
    off = np.concatenate([log.column("gnss_x")[fixed] - x, log.column("gnss_y")[fixed] - y])
    if len(off) < 4 * ANTENNA_ROWS or np.linalg.cond(rows) > 1e8:
        return "not identifiable"
    place, *_ = np.linalg.lstsq(rows, off)
    left = off - rows @ place
    correlated = max(float(left[1:] @ left[:-1] / (left @ left)), 0.0)
    variance = float(left @ left) / (len(left) - rows.shape[1]) * (1 + correlated) / (1 - correlated)
    halves = 1.96 * np.sqrt(variance * np.diag(np.linalg.inv(rows.T @ rows))[:2])
    if max(halves) > SURE_M:
        return "not identifiable without bends"
    return f"{place[0]:.2f} +- {halves[0]:.2f} m and {place[1]:.2f} +- {halves[1]:.2f} m from positions and yaw rate"


def _missing(scenario: Scenario, block: dict[str, Any]) -> Iterator[str]:
    """Yield texts about missing signals that the guidance program needs for good steering."""
    sensors, spec = scenario.sensors, scenario.guidance
    if not block["hellos"]:
        yield "hello messages; connect the program's network module"
    if not block["engaged_s"]:
        yield "engagement; select a line and press the autosteer button"
    if not sensors.imu.enabled:
        yield "roll; enable sensors.imu for work on slopes"
    dual = isinstance(spec, AgOpenGps) and spec.position == "paogi"
    if not (dual or sensors.gyro.enabled):
        yield 'heading at rest; enable sensors.gyro, or use two antennas with guidance.position = "paogi"'
