"""Check of a connection: message rates, latency, effective wheelbase, settings for the program, and missing signals."""

from collections.abc import Iterator
from math import tan
from typing import Any

import numpy as np

from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps
from agrobot_mj.metrics.base import rms
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log

CHECK_S = 20.0
"""Duration of a check [s]."""
TURNING = 0.02
"""Minimum RMS yaw rate for an effective wheelbase [rad/s]. Assumed value: bends of 75 m radius at 1.5 m/s."""


def check_lines(scenario: Scenario, log: Log, block: dict[str, Any]) -> Iterator[str]:
    """Yield the results of a check as text, for the metrics `block` of the link."""
    answered, rate = block["answered_fraction"], block["steer_messages_hz"]
    if answered is not None and rate is not None:
        yield f"rate: {rate:.1f} steering messages per second; {answered:.0%} of the positions answered"
        yield f"latency: median {block['latency_ms_median']:.1f} ms, 95 % below {block['latency_ms_p95']:.1f} ms"
    yield _wheelbase(scenario, log)
    t = scenario.tractor
    yield (
        f"settings: steering limit {t.steer_limit_deg:g} deg; antenna {t.antenna_height_m:g} m high, "
        f"{t.antenna_ahead_m:g} m ahead of the rear axle, {t.antenna_left_m:g} m left"
    )
    yield from (f"missing: {line}" for line in _missing(scenario, block))


def _wheelbase(scenario: Scenario, log: Log) -> str:
    """Return a text with the wheelbase that explains the yaw rate by steering angle and speed."""
    given, rate = scenario.tractor.wheelbase_m, log.column("yaw_rate")
    if (rms(rate) or 0.0) < TURNING:
        return f"wheelbase: {given:g} m; the tractor did not turn, so the yaw rate does not confirm it"
    moved = log.column("speed") * np.vectorize(tan)(log.column("steer"))
    return f"wheelbase: {given:g} m; {float(moved @ rate / (rate @ rate)):.2f} m from the yaw rate"


def _missing(scenario: Scenario, block: dict[str, Any]) -> Iterator[str]:
    """Yield texts about missing signals, without which the program steers worse or not at all."""
    sensors, spec = scenario.sensors, scenario.guidance
    if not block["hellos"]:
        yield "hello messages; connect the program's network module"
    if not block["engaged_s"]:
        yield "engagement; select a line and press the autosteer button"
    if not sensors.imu.enabled:
        yield "roll; for slopes enable sensors.imu"
    dual = isinstance(spec, AgOpenGps) and spec.position == "paogi"
    if not (dual or sensors.gyro.enabled):
        yield "heading at rest; enable sensors.gyro, or two antennas with guidance.position = paogi"
