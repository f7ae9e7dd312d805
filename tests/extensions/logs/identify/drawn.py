"""Machines with random sensors in the simulator, and the logs of their owners.

All quantities that a calibration estimates are random keys of the scenario: antenna position, a receiver of 4 to 20 Hz
with its latency, one of three speed sources, a steering sensor with delay and with one or two scales, play of the
linkage, and the mounting error of two antennas. The plant slips, rolls and pitches, and is independent of the fit.
"""

from functools import cache
from math import nan, pi
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from agrobot_mj import Simulation, load_scenario
from agrobot_mj.core.signals import TICK_S, Fix
from agrobot_mj.extensions.logs.calibrate import Calibration, calibrate
from agrobot_mj.extensions.logs.maps import LogMap

HOMING = 0.15  # Steering angle per heading with which the driver stays near the line [-]
MACHINES = ("compact", "utility", "orchard")


class Drawn(NamedTuple):
    """Hidden properties of a machine and its sensors, in the units of the calibration result."""

    machine: str
    centre: float
    left: float  # Wheel angle per count, steering left [deg]
    right: float  # Wheel angle per count, steering right [deg]
    side: int  # 1 if counts increase to the left, otherwise -1
    noise_deg: float
    play_deg: float
    gyro: bool
    steer_age: float
    two_antennas: bool
    heading_age: float  # Latency of the heading in addition to the latency of the position [s]
    mounting_deg: float
    position_hz: int
    position_age: float
    ahead: float
    aside: float
    speed_from: str  # Source of the speed: receiver, wheel or radar
    wheel_age: float
    speed_error: float  # Relative error of wheel and radar speed [-]
    front: float  # Compliance of the front tyres divided by the compliance in the machine file [-]
    rear: float
    scrubs: bool  # Whether the tyres have a scrubbing moment


def drawn(seed: int) -> Drawn:
    rng = np.random.default_rng([seed, 51])
    left = rng.uniform(0.08, 0.16)
    gyro = bool(rng.integers(2))
    return Drawn(
        machine=str(rng.choice(MACHINES)),
        centre=rng.uniform(1000, 3000),
        left=left,
        right=left * float(rng.choice([1.0, rng.uniform(0.7, 0.9), rng.uniform(1.1, 1.4)])),
        side=int(rng.choice([-1, 1])),
        noise_deg=rng.uniform(0.02, 0.15),
        play_deg=float(rng.choice([0.0, rng.uniform(0.2, 0.8)])),
        gyro=gyro,
        steer_age=TICK_S * int(rng.integers(3)) * gyro,
        two_antennas=bool(rng.integers(4)),
        heading_age=TICK_S * int(rng.integers(3)),
        mounting_deg=float(rng.choice([rng.uniform(-2, 2), rng.uniform(-25, 25)])),
        position_hz=int(rng.choice([4, 5, 10, 20])),
        position_age=TICK_S * int(rng.integers(5)),
        ahead=rng.uniform(-0.3, 1.2),
        aside=rng.uniform(-0.4, 0.4),
        speed_from=str(rng.choice(["receiver", "wheel", "radar"])),
        wheel_age=TICK_S * int(rng.integers(7)),
        speed_error=rng.normal(0.0, 0.02),
        front=rng.uniform(0.4, 1.6),
        rear=rng.uniform(0.4, 1.6),
        scrubs=bool(rng.integers(2)),
    )


def driving(seed: int, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time [s], commanded speed [m/s] and angle [rad] at every tick: slow tight bends, then fast wide bends."""
    rng = np.random.default_rng([seed, 52])
    t = TICK_S * np.arange(round(duration / TICK_S))
    slow_m_s, fast_m_s = rng.uniform(0.8, 1.3), rng.uniform(2.0, 3.2)
    corners = np.array([0, 0.3, 0.35, 0.6, 0.65, 0.85, 0.9, 1]) * duration
    speed = np.interp(t, corners, np.array([slow_m_s, slow_m_s, fast_m_s, fast_m_s, 1.6, 1.6, fast_m_s, fast_m_s]))
    speed = speed + 0.15 * np.sin(2 * pi * t / rng.uniform(9, 17) + rng.uniform(0, 2 * pi))
    f, phase = rng.uniform(0.05, 0.4, 8), rng.uniform(0, 2 * pi, 8)
    swings = np.sin(2 * pi * np.outer(t, f) + phase).sum(axis=1) / 2
    return t, speed, np.radians(np.interp(speed, [1.0, 3.0], [14.0, 5.0]) * swings)


class Owned(NamedTuple):
    """Log and map of a machine as available to its owner, with the true values."""

    table: pa.Table
    log_map: LogMap
    scenario: Any
    truth: dict[str, float]


def owned(seed: int, duration: float = 120.0, h: Drawn | None = None, again: int = 0) -> Owned:
    """Simulate a machine and write its log. The argument `again` selects another drive and other noise for the same
    machine."""
    h = h or drawn(seed)
    _, speeds, angles = driving(seed + 1000 * again, duration)
    keys = {
        "machine": h.machine,
        "controller.kind": "open_loop",
        "estimator.kind": "ekf",
        "physics": "fast",
        "terrain.half_size_m": 500.0,
    }
    keys |= {"duration_s": duration, "seed": seed + 1000 * again, "path.speed_m_s": float(speeds.mean())}
    scenario = load_scenario("straight_line", keys)
    sim = Simulation(scenario.changed({**_tyres(h, scenario), **_sensors(h)}))
    sim.reset()
    # the measurement of the last tick is repeated after the end
    commands = list(zip(angles.tolist(), speeds.tolist(), strict=True))[:-1]
    measured = [sim.step(steer=steer - HOMING * sim.truth.yaw, speed=speed) for steer, speed in commands]
    return Owned(*_written(h, measured), scenario, _truth(h))


def _tyres(h: Drawn, scenario: Any) -> dict[str, float]:
    """Return overrides with the hidden stiffness of the tyres."""
    tyre = scenario.plant.tyre
    found = {} if h.scrubs else {"plant.tyre.patch_half_length_m": 0.0}
    return found | {
        f"plant.tyre.{axle}.lateral.stiffness_per_load": getattr(tyre, axle).lateral.stiffness_per_load
        / getattr(h, axle)
        for axle in ("front", "rear")
    }


def _sensors(h: Drawn) -> dict[str, Any]:
    """Return overrides with the hidden sensors. The steering sensor has a resolution of one count."""
    delays = {"steering_pot": h.steer_age, "heading": h.heading_age, "wheel_speed": h.wheel_age}
    return {
        "tractor.antenna_ahead_m": h.ahead,
        "tractor.antenna_left_m": h.aside,
        "steering.linkage.backlash_deg": h.play_deg,
        "fault": [{"kind": f"{line}_delay", "start_s": 0.0, "delay_s": age} for line, age in delays.items() if age],
        **_table("sensors.steering_pot", samples=1, savgol_window=1, savgol_polyorder=0),
        **_table("sensors.steering_pot", resolution_deg=h.left, noise_sigma_deg=h.noise_deg),
        **_table("sensors.steering_pot", centre_deg=h.side * h.left * (h.centre % 1), scale_right=h.left / h.right),
        **_table("sensors.gyro", enabled=h.gyro, bias_deg_s=0.1),
        **_table("sensors.wheel_speed", enabled=True, scale_error=h.speed_error),
        **_table("sensors.radar_speed", enabled=True, scale_error=h.speed_error, ground_sigma=0.0, sigma_m_s=0.02),
        **_table("sensors.gnss", rate_hz=h.position_hz, latency_s=h.position_age, velocity_sigma_m_s=0.02),
        **_table("sensors.gnss", sigma_m=0.01, correlated_fraction=0.64),
        **_table("sensors.gnss.dual_antenna", enabled=h.two_antennas, mounting_deg=h.mounting_deg),
    }


def _table(name: str, **keys: Any) -> dict[str, Any]:
    """Return scenario overrides by dotted key for the keys of a table."""
    return {f"{name}.{key}": value for key, value in keys.items()}


NO_FIX = Fix(nan, nan, nan, nan, nan)


def _written(h: Drawn, measured: list[Any]) -> tuple[pa.Table, LogMap]:
    """Return log columns and map of a user who does not have centre, scale, sign, latency or antenna position."""
    fixes = [m.fix or NO_FIX for m in measured]
    speeds = {
        "receiver": [np.hypot(fix.vx, fix.vy) for fix in fixes],
        "wheel": [m.wheel_speed for m in measured],
        "radar": [m.readings["radar_speed"] for m in measured],
    }
    columns = {
        "t": [m.t for m in measured],
        "pot": np.floor(h.centre) + h.side * np.rint(np.degrees([m.steer for m in measured]) / h.left),
        "east": [fix.x for fix in fixes],
        "north": [fix.y for fix in fixes],
        "v": 3.6 * np.abs(speeds[h.speed_from]),
    }
    of = {"receiver": "antenna", "radar": "ground", "wheel": "wheel"}[h.speed_from]
    tables: dict[str, Any] = {
        "time": {"column": "t"},
        "steer": {"column": "pot"},
        "speed": {"column": "v", "unit": "km/h", "of": of},
        "position": {"east": "east", "north": "north"},
    }
    if h.gyro:
        columns["gyro"] = np.degrees([m.gyro for m in measured])
        tables["yaw_rate"] = {"column": "gyro"}
    if h.two_antennas:
        columns["course"] = np.mod(90.0 - np.degrees([fix.heading for fix in fixes]), 360.0)
        tables["heading"] = {"column": "course"}
    later = round(2.0 / TICK_S)
    return pa.table({name: pa.array(each[later:], from_pandas=True) for name, each in columns.items()}), LogMap(
        **tables
    )


def _truth(h: Drawn) -> dict[str, float]:
    """Return true values by result key. Latencies are relative to the gyro or, without gyro, to the steering sensor."""
    found = {
        "steer.offset": h.centre,
        "steer.scale": h.left,
        "steer.scale_right": h.right,
        "steer.delay_s": h.steer_age,
        "speed.delay_s": {"receiver": h.position_age, "wheel": h.wheel_age, "radar": 0.0}[h.speed_from],
        "position.delay_s": h.position_age,
        "position.ahead_m": h.ahead,
        "position.left_m": h.aside,
    }
    if h.two_antennas:
        found |= {"heading.delay_s": h.position_age + h.heading_age, "heading.offset": -h.mounting_deg}
    return found


@cache
def calibrated(seed: int, duration: float, again: int) -> Calibration:
    """Return the calibration from a drive of a machine."""
    log = owned(seed, duration, again=again)
    return calibrate([log.table], log.log_map, log.scenario)


def errors(seed: int, duration: float = 120.0) -> dict[str, tuple[float, float, bool]]:
    """Return for each quantity its error and the half width of its interval [unit of the quantity], and whether the
    quantity is identified."""
    truth = _truth(drawn(seed))
    return {
        key: (each.value - truth[key], each.half, each.identified)
        for key, each in calibrated(seed, duration, 0).found.items()
        if key in truth
    }
