"""Public logs of real machines, read from clones of their repositories: nothing of them is copied.

A clone may be bare or have a work tree; files are read at the stated commit, whatever is checked out.
"""

import subprocess
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv

from agrobot_mj.core.signals import Array

RIDING_TRACTOR = ("https://github.com/jones2126/tractor2025", "8ae4926f8cd0e61d2ff0aaa6e6ac056dddbbc9c6")
"""Address and commit of the logs of a Cub Cadet XT1 steered by RTK."""
STEERING_BUS = ("https://github.com/BL08FR/AOG-Canbus-tools-program-s", "327078f5e3338e5b889f705e3d26951d512bc30c")
"""Address and commit of the CAN logs of a Massey Ferguson 7720."""
FOLDER = "field_testing/sites/62_Collins_polygon_1/runs/"
GGA = {"RTK Fixed": 4.0, "RTK Float": 5.0, "DGPS": 2.0, "GPS Fix": 1.0, "Invalid": 0.0}
"""Numbers of the qualities that the logger writes as words, as in GGA."""
AUTO = 0
"""Value of `trans_mode` while the guidance drives."""


class Repository(NamedTuple):
    """A clone and the commit at which it is read."""

    folder: Path
    address: str
    commit: str

    def read(self, path: str) -> bytes:
        """The content of a file. Ends the program where it is not there, and says how to get it."""
        command = ("git", "-C", str(self.folder), "cat-file", "blob", f"{self.commit}:{path}")
        found = subprocess.run(command, capture_output=True, check=False)
        if found.returncode:
            raise SystemExit(
                f"{self.folder}: has no {path} at commit {self.commit[:9]}; get it with\n"
                f"git clone {self.address} {self.folder} && git -C {self.folder} cat-file -t {self.commit}"
            )
        return found.stdout

    def table(self, path: str, skip: int = 0) -> pa.Table:
        """A CSV file, without `skip` rows below its head."""
        read = pacsv.ReadOptions(skip_rows_after_names=skip)
        return pacsv.read_csv(BytesIO(self.read(path)), read_options=read)


class Run(NamedTuple):
    """One recording of the field logger, and that of the guidance beside it if there is one."""

    name: str
    field: str
    pursuit: str = ""
    speed: float = 0.5  # speed that the mission asks for [m/s]


def _straight(name: str, field: int, pursuit: int, speed: float = 0.5) -> Run:
    folder = f"{FOLDER}20260804_north_steering/"
    return Run(
        name,
        f"{folder}north_steering_{name}_20260804_{field}.csv",
        f"{folder}pursuit_log_20260804_{pursuit}.csv",
        speed,
    )


CALIBRATION = (_straight("1W", 123208, 123210), _straight("1E", 122428, 122431))
"""Runs on which everything is fitted."""
HELD_OUT = (
    _straight("2W", 124806, 124808),
    _straight("2E", 124248, 124250),
    _straight("2W85", 131735, 131737, 0.85),
    _straight("2E85", 131151, 131153, 0.85),
)
"""Runs that are predicted."""
COVERAGE = Run("coverage", f"{FOLDER}20260727_144659/field_test_20260727_144659.csv")
MISSION = f"{FOLDER}20260727_144659/62_Collins_polygon_1/62_Collins_polygon_1_mission.txt"
"""Waypoints of the coverage run: latitude, longitude, heading [rad], look-ahead [m], speed [m/s]."""
_ENGINE, _MOWER = "20260805_stationary_engine_gps_test/", "20260805_stationary_mower_off_on_after_coax/"
STANDING = tuple(
    Run(name, f"{FOLDER}{file}_20260805.csv")
    for name, file in (
        ("engine on", f"{_ENGINE}stationary_engine_on"),
        ("engine off and on", f"{_ENGINE}stationary_engine_transition"),
        ("mower off", f"{_MOWER}stationary_mower_off_jrk_recovery"),
        ("mower off and on", f"{_MOWER}stationary_mower_off_on_120s_after_coax_tighten"),
    )
)
"""Recordings of the tractor at rest."""


class FieldLog(NamedTuple):
    """Columns of the field logger, shape (n,) each; NaN where nothing new has come."""

    t: Array  # time since 1970 [s]
    pot: Array  # steering potentiometer, larger to the left [counts]
    pwm: Array  # drive of the steering motor, left positive [counts of 255]
    latitude: Array
    longitude: Array
    quality: Array  # as in GGA
    heading: Array  # from two antennas, clockwise from north; NaN where it is not valid [deg]
    valid: Array  # 1 where the logger calls the heading valid, else 0
    carrier: Array  # 1 where the logger says "fixed", else 0
    speed: Array  # unsigned [m/s]
    auto: Array  # 1 while the guidance drives, else 0
    receiver: Array
    """1 where any column of the position's receiver has changed, its speed and age of corrections among them."""
    antennas: Array  # 1 where the heading has changed

    @property
    def table(self) -> pa.Table:
        """What a replay needs, time from the first row on."""
        names = ("pot", "latitude", "longitude", "quality", "heading", "speed")
        columns = {name: pa.array(getattr(self, name), from_pandas=True) for name in names}
        return pa.table({"t": self.t - self.t[0], **columns})


def field_log(repository: Repository, run: Run) -> FieldLog:
    """A recording of the field logger, which repeats position and heading until new ones come."""
    table = repository.table(run.field)
    latitude, longitude, heading = (numbers(table, name) for name in ("lat", "lon", "heading_deg"))
    new = fresh(latitude, longitude)
    valid = truths(table, "head_valid")
    quality = np.array([GGA.get(word, 0.0) for word in table["fix_quality"].to_pylist()])
    left, right = (
        numbers(table, name) if name in table.column_names else np.full(len(valid), np.nan)
        for name in ("steer_left_pwm", "steer_right_pwm")
    )
    speed, age = numbers(table, "speed_mps"), numbers(table, "diff_age")
    return FieldLog(
        t=table["time"].cast(pa.timestamp("us", "UTC")).cast(pa.int64()).to_numpy() * 1e-6,
        pot=numbers(table, "steer_current"),
        pwm=left - right,
        latitude=np.where(new, latitude, np.nan),
        longitude=np.where(new, longitude, np.nan),
        quality=quality,
        heading=np.where(fresh(heading) & (valid > 0), heading, np.nan),
        valid=valid,
        carrier=pc.equal(table["carrier"], "fixed").cast(pa.float64()).to_numpy(),
        speed=speed,
        auto=(numbers(table, "trans_mode") == AUTO).astype(float),
        receiver=fresh(latitude, longitude, speed, age).astype(float),
        antennas=fresh(heading).astype(float),
    )


class PursuitLog(NamedTuple):
    """Columns of the guidance, shape (n,) each."""

    t: Array  # time since 1970 [s]
    x: Array  # position, east of the mission's origin [m]
    y: Array
    index: Array  # index of the waypoint that it steers for
    total: int  # number of waypoints
    target_x: Array
    target_y: Array
    heading: Array  # clockwise from north [deg]
    aside: Array  # lateral distance of the waypoint, left positive [m]
    wanted: Array  # steering angle, left positive [deg]
    driving: Array  # 1 where it drives, 0 where it waits
    reason: Sequence[str]  # why it waits


def pursuit_log(repository: Repository, run: Run) -> PursuitLog:
    """A recording of the guidance; its second row explains the columns."""
    table = repository.table(run.pursuit, skip=1)
    names = ("timestamp", "pos_x_m", "pos_y_m", "waypoint_idx", "target_x_m", "target_y_m", "heading_compass_deg")
    t, x, y, index, *rest = (numbers(table, name) for name in (*names, "yt_m", "delta_deg"))
    reason = [word or "" for word in table["wait_reason"].to_pylist()]
    total = int(np.nanmax(numbers(table, "waypoints_total")))
    return PursuitLog(t, x, y, index, total, *rest, driving=truths(table, "driving"), reason=reason)


def numbers(table: pa.Table, name: str) -> Array:
    """A column as floats, NaN where a cell is empty."""
    found: Array = table[name].cast(pa.float64()).to_numpy()
    return found


def truths(table: pa.Table, name: str) -> Array:
    """A column of true and false as 1 and 0."""
    return np.array([float(str(value) == "True") for value in table[name].to_pylist()])


def fresh(*columns: Array) -> np.ndarray:
    """Which rows differ from the one before in any of the columns."""
    differs = np.any([np.diff(column, prepend=np.nan) != 0.0 for column in columns], axis=0)
    return np.asarray(differs)
