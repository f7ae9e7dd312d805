"""Logs as recorded by users: a kinematic machine on a path, with sensor values in the units of the manufacturers."""

from math import pi, radians

import numpy as np
import pyarrow as pa

from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.recording import read_recording

STEP_S, WHEELBASE_M = 0.01, 2.5


def path(duration=60.0, speed=2.0, swing_deg=8.0, reverse=()):
    """Return time, signed speed, wheel angle, x, y and yaw of the rear axle at 100 Hz. `reverse` contains the intervals
    of reverse travel [s]."""
    t = np.arange(0.0, duration, STEP_S)
    u = speed * (1 + 0.2 * np.sin(t / 7))
    for start, end in reverse:
        u = u * np.interp(t, [start - 1, start, start + 1, end - 1, end, end + 1], [1, 0, -1, -1, 0, 1])
    return motion(t, u, radians(swing_deg) * (0.6 * np.sin(t / 2.1) + 0.4 * np.sin(t / 0.9)))


def motion(t, u, wheel, wheelbase=WHEELBASE_M):
    """Return time, signed speed, wheel angle, x, y and yaw of the rear axle for speeds and wheel angles at 100 Hz."""
    yaw = np.cumsum(u * np.tan(wheel) / wheelbase) * STEP_S
    x, y = (np.cumsum(u * each) * STEP_S for each in (np.cos(yaw), np.sin(yaw)))
    return t, u, wheel, x, y, yaw


def field_log(driven, every=5, noise_m=0.01, ahead=0.0, signed=False, heading=True, seed=1, counts=None):
    """Return the columns of a log with one row per `every` steps. The function `counts` converts angles [rad] to sensor
    counts."""
    t, u, wheel, x, y, yaw = (each[::every] for each in driven)
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((5, len(t)))
    columns = {
        "t": t,
        "steer": np.degrees(wheel) + 0.05 * noise[0] if counts is None else np.round(counts(wheel) + noise[0]),
        "speed": (u if signed else np.abs(u)) + 0.01 * noise[1],
        "east": x + ahead * np.cos(yaw) + noise_m * noise[2],
        "north": y + ahead * np.sin(yaw) + noise_m * noise[3],
    }
    if heading:
        columns["heading"] = np.degrees((yaw + pi) % (2 * pi) - pi) + 0.05 * noise[4]
    return columns


def field_map(columns, **tables):
    """Return the map of a log. `tables` contains changed keys of the map."""
    found = {
        "time": {"column": "t"},
        "steer": {"column": "steer"},
        "speed": {"column": "speed"},
        "position": {"east": "east", "north": "north"},
    }
    if "heading" in columns:
        found["heading"] = {"column": "heading", "convention": "enu"}
    return LogMap.model_validate({name: found.get(name, {}) | tables.get(name, {}) for name in found.keys() | tables})


def recorded(columns, readings=False, **tables):
    """Return the recording of a log."""
    return read_recording(pa.table(columns), field_map(columns, **tables), 2.0, readings)
