"""Machines with randomly drawn sensors, simulated on the simulator's plant, and the logs that their owners would have.

Everything that a calibration estimates is drawn: position of the antenna, receivers of 4 to 20 Hz with a latency each,
three sources of the speed, a steering sensor with one scale or two scales about one centre, its play and delay, and the
mounting error of two antennas. The plant has slip, roll and pitch, and is independent of the fit.
"""

from math import pi, radians
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from stranger import behind_play, slow

from agrobot_mj import load_scenario
from agrobot_mj.extensions.logs.calibrate import calibrate
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.driving import drive
from agrobot_mj.extensions.logs.series import TimeSeries

ROW_S, STEP_S = 0.05, 0.01
MACHINES = ("compact", "utility", "orchard")


class Drawn(NamedTuple):
    """Hidden properties of a machine and its sensors, in the units of the calibration result."""

    machine: str
    centre: float
    left: float
    """Wheel angle per count, steering left [deg]."""
    right: float
    """Wheel angle per count, steering right [deg]."""
    side: int
    """1 if counts increase to the left, otherwise -1."""
    noise_deg: float
    play_deg: float
    gyro: bool
    steer_age: float
    heading_hz: int
    """Rate of the heading of two antennas [Hz]; 0 without them."""
    heading_age: float
    mounting_deg: float
    position_hz: int
    position_age: float
    ahead: float
    aside: float
    speed_from: str
    """Source of the speed: `receiver`, `wheel` or `radar`."""
    speed_age: float
    front: float
    """Stiffness of the front tyres per stiffness in the machine's file [-]."""
    rear: float


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
        steer_age=rng.uniform(0.0, 0.1) * gyro,
        heading_hz=int(rng.choice([0, 5, 10, 20])),
        heading_age=rng.uniform(0.0, 0.25),
        mounting_deg=float(rng.choice([rng.uniform(-2, 2), rng.uniform(-25, 25)])),
        position_hz=int(rng.choice([4, 5, 10, 20])),
        position_age=rng.uniform(0.0, 0.2),
        ahead=rng.uniform(-0.3, 1.2),
        aside=rng.uniform(-0.4, 0.4),
        speed_from=str(rng.choice(["receiver", "wheel", "radar"])),
        speed_age=rng.uniform(0.0, 0.3),
        front=rng.uniform(0.7, 1.4),
        rear=rng.uniform(0.7, 1.4),
    )


def driving(seed: int, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time, speed [m/s] and sensor angle [rad] at every step: slow tight bends, then fast wide bends."""
    rng = np.random.default_rng([seed, 52])
    t = np.arange(0.0, duration, STEP_S)
    slow_m_s, fast_m_s = rng.uniform(0.8, 1.3), rng.uniform(2.0, 3.2)
    corners = np.array([0, 0.3, 0.35, 0.6, 0.65, 0.85, 0.9, 1]) * duration
    speed = np.interp(t, corners, np.array([slow_m_s, slow_m_s, fast_m_s, fast_m_s, 1.6, 1.6, fast_m_s, fast_m_s]))
    speed = speed + 0.15 * np.sin(2 * pi * t / rng.uniform(9, 17) + rng.uniform(0, 2 * pi))
    f, phase = rng.uniform(0.05, 0.4, 8), rng.uniform(0, 2 * pi, 8)
    swings = np.sin(2 * pi * np.outer(t, f) + phase).sum(axis=1) / 2
    return t, speed, np.radians(np.interp(speed, [1.0, 3.0], [14.0, 5.0]) * swings)


class Owned(NamedTuple):
    """Log and map of a machine as its owner has them, with the true values."""

    table: pa.Table
    log_map: LogMap
    scenario: Any
    truth: dict[str, float]


def owned(seed: int, duration: float = 120.0, h: Drawn | None = None, again: int = 0) -> Owned:
    """Simulate a machine and write its log. `again` selects another drive and other noise for the same machine."""
    h = h or drawn(seed)
    scenario = load_scenario("straight_line", {"machine": h.machine, "physics": "fast", "terrain.half_size_m": 500.0})
    at, speed, sensor = driving(seed + 1000 * again, duration)
    wheel = behind_play(sensor, radians(h.play_deg))
    recording = FieldRecording(
        name="drawn",
        start=0.0,
        end=float(at[-1]),
        speed=TimeSeries(at, speed),
        wheel_speed=h.speed_from == "wheel",
        antenna_speed=False,
        steer=TimeSeries(at, wheel),
        voltage=None,
        yaw_rate=None,
        yaw_rate_source="none",
        heading=None,
        position=None,
        left_out=(),
        arm=(h.ahead, h.aside, scenario.tractor.antenna_height_m),
        inputs={},
        signed=True,
    )
    driven = drive(scenario.changed(_tyres(h, scenario)), recording, (0.0, 0.0, 0.0))
    assert driven.outcome == "completed", driven.outcome
    read = sensor + np.interp(at, driven.t, driven.steer) - wheel
    return Owned(*_written(h, driven, at, read, [seed, 53, again]), scenario, _truth(h))


def _tyres(h: Drawn, scenario: Any) -> dict[str, float]:
    """Return overrides with the hidden stiffness of the tyres."""
    tyre = scenario.plant.tyre
    return {
        f"plant.tyre.{axle}.lateral.stiffness_per_load": getattr(h, axle)
        * getattr(tyre, axle).lateral.stiffness_per_load
        for axle in ("front", "rear")
    }


def _written(h: Drawn, driven: Any, at: np.ndarray, sensor: np.ndarray, seed: list[int]) -> tuple[pa.Table, LogMap]:
    """Return log and map of an owner who does not know centre, scale, sign, latency or position of any sensor."""
    rng = np.random.default_rng(seed)
    t = np.arange(2.0, driven.t[-1] - 0.5, ROW_S)
    n = len(t)

    def seen(values, age):
        return np.interp(t - age, driven.t, values)

    def received(values, hz, phase=0):
        rows = round(1 / (hz * ROW_S))
        return np.where((np.arange(n) + phase) % rows == 0, values, np.nan)

    angle = np.degrees(np.interp(t - h.steer_age, at, sensor)) + h.noise_deg * rng.standard_normal(n)
    x, y = (
        seen(each, h.position_age) + 0.006 * rng.standard_normal(n) + slow(rng, n, 0.008, 30, ROW_S)
        for each in driven.point.T
    )
    columns = {
        "t": t,
        "pot": np.rint(h.centre + h.side * angle / np.where(angle > 0, h.left, h.right)),
        "east": received(x, h.position_hz),
        "north": received(y, h.position_hz),
    }
    over_ground = np.hypot(*(np.gradient(each, driven.t) for each in driven.point.T))
    source = over_ground if h.speed_from == "receiver" else driven.speed
    rate = h.position_hz if h.speed_from == "receiver" else round(1 / ROW_S)
    columns["v"] = received(3.6 * np.abs(seen(source, h.speed_age) + 0.02 * rng.standard_normal(n)), rate)
    tables = {
        "time": {"column": "t"},
        "steer": {"column": "pot"},
        "speed": {
            "column": "v",
            "unit": "km/h",
            "of": {"receiver": "antenna", "radar": "ground"}.get(h.speed_from, "wheel"),
        },
        "position": {"east": "east", "north": "north"},
    }
    if h.gyro:
        columns["gyro"] = np.degrees(seen(driven.yaw_rate, 0.0)) + 0.1 + 0.1 * rng.standard_normal(n)
        tables["yaw_rate"] = {"column": "gyro"}
    if h.heading_hz:
        off = h.mounting_deg + 0.1 * rng.standard_normal(n) + slow(rng, n, 0.1, 60, ROW_S)
        compass = 90.0 - np.degrees(seen(driven.yaw, h.heading_age)) - off
        columns["course"] = received(np.mod(compass, 360.0), h.heading_hz, 1)
        tables["heading"] = {"column": "course"}
    return pa.table({name: pa.array(each, from_pandas=True) for name, each in columns.items()}), LogMap(**tables)


def _truth(h: Drawn) -> dict[str, float]:
    """Return true values by the keys of the result. Latencies are relative to the gyro, or else to the steering."""
    found = {
        "steer.offset": h.centre,
        "steer.scale": h.left,
        "steer.scale_right": h.right,
        "steer.delay_s": h.steer_age,
        "speed.delay_s": h.speed_age,
        "position.delay_s": h.position_age,
        "position.ahead_m": h.ahead,
        "position.left_m": h.aside,
    }
    if h.heading_hz:
        found |= {"heading.delay_s": h.heading_age, "heading.offset": -h.mounting_deg}
    return found


def errors(seed: int, duration: float = 120.0) -> dict[str, tuple[float, float, bool]]:
    """Return error, half width of the interval [unit of the quantity], and whether it is identified, by quantity."""
    log = owned(seed, duration)
    found = calibrate([log.table], log.log_map, log.scenario).found
    return {
        key: (each.value - log.truth[key], each.half, each.identified)
        for key, each in found.items()
        if key in log.truth
    }
