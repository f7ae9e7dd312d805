"""Estimators on recorded drives; `python -m agrobot_mj.studies.validation.filters` prints the
tables of docs/estimators.md.

A drive is the truth of a run of the paper's stack, recorded once. Sensors with other seeds measure it again and an
estimator follows, at a tenth of the cost of the run: twenty seeds per case for `ekf_full`, over four drives. Gyro,
wheel speed and inertial unit are on, with the errors of `SENSORS`.
"""

import sys
import time
from collections.abc import Callable
from math import degrees, nan, radians
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
DRIVES, SEEDS, OTHER_SEEDS, DURATION_S = 4, 20, 4, 120.0
"""Recorded drives, seeds of the sensors for `ekf_full` and for the others, and length of a drive [s]."""

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
    heading = _wrapped(yaw - sideslip - np.array([t.yaw for t in truths]))
    return ErrorTrace(
        t=np.array([t.t for t in truths]),
        east=error[:, 0],
        north=error[:, 1],
        heading=heading,
        course=_wrapped(yaw - np.arctan2(v_y, v_x)),
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


def _wrapped(angles: Array) -> Array:
    return np.array([wrap(angle) for angle in angles.tolist()])


FULL, BIAS, PAPER = {"kind": "ekf_full"}, {"kind": "ekf_bias"}, {"kind": "ekf"}
KINDS = (PAPER, BIAS, FULL)
TILT = {"terrain_compensation": True}
SLOPE = {"terrain": {"kind": "slope", "grade_deg": 10.0, "direction_deg": 90.0}}
CASES: dict[str, tuple[dict[str, Any], dict[str, Any], Day]] = {
    "level": ({}, {}, nominal),
    "level, fixes 0.2 s late": ({}, {}, late(0.2)),
    "soil": ({"plant.tyre.kind": "soil"}, {}, nominal),
    "side slope 10 deg, compensated": (SLOPE, TILT, nominal),
    "rough ground of class D, compensated": ({"terrain": {"kind": "rough", "iso_class": "D"}}, TILT, nominal),
}
"""Figure eights: overrides of the run, of the estimator, and the day."""
LOSS_STARTS_S = (25.0, 75.0)
"""Beginnings of the losses, each 20 s or more before the end of an arc [s]."""
HEADINGS_DEG = (0, 45, 90, 135, 180, -90)
"""Errors of the start heading [deg]."""

HEADS = (
    *("case", "estimator", "position [cm]", "heading [deg]", "course [deg]", "yaw rate [deg/s]"),
    *("NEES", "NIS", "time [us]"),
)


def main() -> None:
    """Print the tables."""
    say = sys.stdout.write
    drives: dict[str, list[RecordedDrive]] = {}
    say(f"| {' | '.join(HEADS)} |\n| --- | --- |{' ---: |' * (len(HEADS) - 2)}\n")
    for case, (run, keys, day) in CASES.items():
        key = str(run)
        drives[key] = drives.get(key) or [record("figure_eight", {**run, "seed": k + 1}) for k in range(DRIVES)]
        for kind in KINDS:
            numbers = [settled(follow(drive, {**kind, **keys}, seed, day)) for drive, seed in _runs(drives[key], kind)]
            say(f"| {case} | {kind['kind']} | {' | '.join(f'{v:.3g}' for v in np.mean(numbers, axis=0))} |\n")
            sys.stdout.flush()
    level = drives[str({})]
    for lines in (_coasting(level), _outliers(level), _alignments(level)):
        say(lines)
        sys.stdout.flush()


def _runs(
    drives: list[RecordedDrive], kind: dict[str, Any], until: float = DURATION_S
) -> list[tuple[RecordedDrive, int]]:
    """Drives up to a time [s], each with a seed of its sensors."""
    seeds = SEEDS if kind is FULL else OTHER_SEEDS
    ticks = round(until / TICK_S)
    short = [drive._replace(truths=drive.truths[:ticks]) for drive in drives]
    return [(short[k % DRIVES], 100 + k) for k in range(seeds)]


def _coasting(drives: list[RecordedDrive]) -> str:
    lines = ["\n| loss in an arc | estimator | rms [cm] | worst [cm] |\n| --- | --- | ---: | ---: |\n"]
    for seconds in (5.0, 20.0):
        for kind in KINDS:
            ends = [(start, start + seconds) for start in LOSS_STARTS_S]
            off = np.array([
                coasted(follow(drive, kind, seed, loss(start, seconds)), end)
                for start, end in ends
                for drive, seed in _runs(drives, kind, end)
            ])  # fmt: skip
            lines.append(f"| {seconds:g} s | {kind['kind']} | {rms(off):.3g} | {off.max():.3g} |\n")
    return "".join(lines)


def _outliers(drives: list[RecordedDrive]) -> str:
    lines = ["\n| one fix off by 2 m | moves the estimate by, worst [cm] |\n| --- | ---: |\n"]
    for kind in KINDS:
        moved = []
        for drive, seed in _runs(drives, kind, 40.0):
            clean, struck = (follow(drive, kind, seed, day) for day in (nominal, outlier(30.0, 2.0)))
            moved.append(100 * float(np.hypot(struck.east - clean.east, struck.north - clean.north).max()))
        lines.append(f"| {kind['kind']} | {max(moved):.2g} |\n")
    return "".join(lines)


def _alignments(drives: list[RecordedDrive]) -> str:
    lines = ["\n| start heading off by | found after, worst [m] | heading after 5 m, rms [deg] | worst [deg] |\n"]
    lines.append("| ---: | ---: | ---: | ---: |\n")
    for error in HEADINGS_DEG:
        runs = _runs(drives, FULL, 15.0)
        found = [alignment(follow(drive, FULL, seed, yaw_error=radians(error))) for drive, seed in runs]
        metres, off = np.transpose(found)
        lines.append(f"| {error} deg | {metres.max():.2f} | {rms(off):.2f} | {off.max():.2f} |\n")
    return "".join(lines)


if __name__ == "__main__":
    main()
