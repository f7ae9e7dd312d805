"""The coverage run of the riding tractor: a sensor that slips, and turns of a keyhole's shape."""

from io import BytesIO
from math import degrees, radians
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geodesy import Origin, local_points
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.logs.pieces import spells
from riding_tractor.closed_loop import Board, Loop, steady_offset
from riding_tractor.logs import COVERAGE, MISSION, Repository, field_log

STRAIGHT_M = 3.0
"""Look-ahead of the mission on its straights, and of no other part [m]."""
SETTLED_S = 8.0
"""Time from the begin of a straight that does not count, nor before its end [s]."""
EVEN_S = 0.2
"""Time between rows of the log [s]."""
NEAR_M, ALONG = 1.0, radians(20.0)
"""Distance and heading within which a waypoint is the one beside the tractor [m, rad]."""
DRIVING_M_S = 0.3
"""Speed below which it stops or starts, its wheels on the way to or from the firmware's centre [m/s]."""
LEAST_ROWS = 30
"""Rows of a straight that count at least: six seconds."""


class Track(NamedTuple):
    """The run on an even grid of time, shape (n,) each, and its mission."""

    t: Array  # time since the first row [s]
    x: Array  # east of the mission's first waypoint [m]
    y: Array
    yaw: Array  # from east, counter-clockwise, unwrapped [rad]
    pot: Array
    speed: Array
    auto: Array
    mission: Array  # east, north, heading [rad], look-ahead [m] and speed [m/s] of the waypoints, shape (m, 5)


def track(repository: Repository) -> Track:
    """The coverage run beside its mission."""
    log = field_log(repository, COVERAGE)
    waypoints = np.loadtxt(BytesIO(repository.read(MISSION)))
    origin = Origin(*waypoints[0, :2].tolist())
    mission = np.column_stack((local_points(origin, waypoints[:, 0], waypoints[:, 1]), waypoints[:, 2:]))
    t = log.t - log.t[0]
    there, turned = np.isfinite(log.latitude), np.isfinite(log.heading)
    places = local_points(origin, log.latitude[there], log.longitude[there])
    even = np.arange(0.0, t[-1], EVEN_S)
    yaw = np.unwrap(np.radians(90.0 - log.heading[turned]))
    return Track(
        even,
        *(np.interp(even, t[there], each) for each in places.T),
        np.interp(even, t[turned], yaw),
        *(np.interp(even, t, each) for each in (log.pot, log.speed)),
        np.floor(np.interp(even, t, log.auto)),
        mission,
    )


class Straight(NamedTuple):
    """A straight pass of the coverage run."""

    t: float  # its middle [s]
    pot: float  # reading of the potentiometer while it drives straight on [counts]
    left: float  # median offset from the mission, left of the vehicle [m]
    westwards: bool

    def expected(self, heading_error: float) -> float:
        """Offset that the firmware's constants and that reading ask for [m], under a heading error [deg]."""
        return steady_offset(Board().bias(self.pot), radians(heading_error), STRAIGHT_M)


def straights(found: Track) -> list[Straight]:
    """Straight passes under guidance, in the order of time."""
    beside = _beside(found)
    inside = (beside >= 0) & (found.auto > 0) & (found.mission[beside, 3] == STRAIGHT_M)
    passes, cut = [], round(SETTLED_S / EVEN_S)
    for a, b in spells(inside):
        rows = a + cut + np.flatnonzero(found.speed[a + cut : b - cut] > DRIVING_M_S)
        if len(rows) < LEAST_ROWS:
            continue
        k = beside[rows]
        east, north, heading = found.mission[k, :3].T
        left = (found.y[rows] - north) * np.cos(heading) - (found.x[rows] - east) * np.sin(heading)
        passes.append(
            Straight(
                float(found.t[rows].mean()),
                float(np.median(found.pot[rows])),
                float(np.median(left)),
                bool(np.cos(heading[0]) < 0.0),
            )
        )
    return passes


def _beside(found: Track) -> np.ndarray:
    """Index of the mission's waypoint beside each row, -1 where there is none near on the same heading."""
    east, north, heading = found.mission[:, :3].T
    nearest = np.full(len(found.t), -1)
    for row, (x, y, yaw) in enumerate(zip(found.x, found.y, found.yaw, strict=True)):
        turned = np.abs(np.angle(np.exp(1j * (heading - yaw)))) < ALONG
        away = np.where(turned, np.hypot(east - x, north - y), np.inf)
        k = int(away.argmin())
        if away[k] < NEAR_M:
            nearest[row] = k
    return nearest


def drift(passes: list[Straight]) -> tuple[float, float, float]:
    """Readings straight ahead of the first and the last three passes [counts], and minutes between them."""
    first, last = passes[:3], passes[-3:]
    minutes = (np.mean([p.t for p in last]) - np.mean([p.t for p in first])) / 60.0
    return float(np.mean([p.pot for p in first])), float(np.mean([p.pot for p in last])), float(minutes)


class Turn(NamedTuple):
    """A keyhole turn of the mission."""

    name: str
    first: int  # index of its first waypoint
    last: int


TURNS = (Turn("to the left", 1284, 1311), Turn("to the right", 1355, 1381))
LEAD, FOLLOW = 12, 12
"""Waypoints of the straights before and after a turn that belong to it."""


class TurnDriven(NamedTuple):
    """Ways of a turn, each (2, n) [m]."""

    planned: Array
    recorded: Array
    simulated: Array
    span: tuple[float, float]  # begin and end in the log [s]
    centre: float  # reading straight ahead at that time [counts]

    @property
    def off_plan(self) -> tuple[float, float]:
        """Largest distance from the plan, recorded and simulated [m]."""
        recorded, simulated = (float(beside(way, self.planned).max()) for way in (self.recorded, self.simulated))
        return recorded, simulated

    @property
    def apart(self) -> tuple[float, float]:
        """Distance of the simulated way from the recorded one, rms and largest [m]."""
        away = beside(self.simulated, self.recorded)
        return float(np.sqrt(np.mean(away**2))), float(away.max())


def turn(found: Track, passes: list[Straight], loop: Loop, wanted: Turn) -> TurnDriven:
    """A turn as recorded, and the twin under its guidance from the recorded pose before it."""
    waypoints = found.mission[wanted.first - LEAD : wanted.last + FOLLOW]
    begin, end = (_passing(found, waypoints[k]) for k in (0, -1))
    rows = slice(begin, end + 1)
    t = float(found.t[rows].mean())
    centre = float(np.interp(t, [p.t for p in passes], [p.pot for p in passes]))
    path = {
        "kind": "line",
        "start_x_m": float(found.x[begin]),
        "start_y_m": float(found.y[begin]),
        "heading_deg": degrees(found.yaw[begin]),
        "speed_m_s": float(waypoints[0, 4]),
        "length_m": 100.0,
    }
    driven = loop._replace(centre=centre).follow({"path": path}, waypoints[:, [0, 1, 3, 4]])
    recorded = np.stack((found.x[rows], found.y[rows]))
    span = float(found.t[begin]), float(found.t[end])
    return TurnDriven(waypoints[:, :2].T, recorded, driven.rows[4:6], span, centre)


def _passing(found: Track, waypoint: Array) -> int:
    """Row in which the tractor passes a waypoint under guidance, on its heading."""
    turned = np.abs(np.angle(np.exp(1j * (waypoint[2] - found.yaw)))) < ALONG
    away = np.where(turned & (found.auto > 0), np.hypot(found.x - waypoint[0], found.y - waypoint[1]), np.inf)
    return int(away.argmin())


def beside(way: Array, line: Array) -> Array:
    """Distances of points (2, n) from a line through points (2, m) [m]."""
    a, b = line[:, :-1, None], line[:, 1:, None]
    along = b - a
    share = ((way[:, None, :] - a) * along).sum(axis=0) / np.maximum((along**2).sum(axis=0), 1e-12)
    foot = a + np.clip(share, 0.0, 1.0) * along
    found: Array = np.hypot(*(way[:, None, :] - foot)).min(axis=0)
    return found
