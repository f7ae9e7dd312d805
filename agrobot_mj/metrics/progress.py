"""Progress: how much of the path the tractor drove, and whether that is enough to call the path driven.

The path is that of the reference until the planned end of the run, or to its own end if that comes first. A piece of
it is driven by moving along it within CORRIDOR_M. The nearest point is followed from place to place of the tractor, so
that neither the other branch of a crossing, nor another lap or the neighbouring swath is taken for it, and on the leg
between two reversals on which the reference is at that time. A tractor that has strayed from that point is also sought
beside the reference. What the nearest point leaps over is not driven: a tractor that stands still drives nothing,
wherever the reference goes.
"""

from bisect import bisect_right
from collections.abc import Iterator
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array, Column
from agrobot_mj.metrics.base import Metric, RunView
from agrobot_mj.paths import Path

Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

CORRIDOR_M = 5.0
"""Distance from the path within which it is driven [m]. Estimate: two swaths; errors tell the rest."""
ENOUGH = 0.9
"""Least share of the path that must be driven [-]. Estimate."""
LATE_S = 2.0
"""Delay behind the reference that a tractor that drives is granted at the end [s]. Estimate: it starts from rest."""
STEP_M = 0.25
"""Spacing of the points of the path, and of the places of the tractor, that are looked at [m]."""
ASTRAY_M = 1.0
"""Distance from the path at which the tractor is also sought beside the reference [m]."""
LEAP_M = 1.5
"""Longest piece of the path that is driven between two places: in a bend, the tractor inside, more than STEP_M [m]."""

PIECE = 5_000
"""Rows and points that are looked at together, for the sake of memory."""
FARTHEST_M = 1e7
"""Distance from the origin beyond which a position is none [m]: a quarter of the equator."""


class PathProgress(NamedTuple):
    """How much of its path a tractor drove."""

    driven: float
    """Length that was driven [m]."""
    length: float
    """Length of the path [m]."""
    due: float
    """Length that the reference has passed LATE_S before the planned end [m]."""

    @property
    def share(self) -> float | None:
        """Share of the length that was driven; None where the path is shorter than STEP_M [-]."""
        return self.driven / self.length if self.length >= STEP_M else None

    @property
    def enough(self) -> bool:
        """Whether the path counts as driven."""
        return self.driven + STEP_M >= ENOUGH * self.due


class DrivenShare(Metric):
    """How much of its path the tractor drove."""

    kind: Literal["progress"] = "progress"
    columns: ClassVar = (Column("progress", "-", "share of the path's length that was driven; null where it has none"),)

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """That of `progress_of`."""
        return {"progress": progress_of(view).share}


def progress_of(view: RunView) -> PathProgress:
    """How much of the path of a run was driven, up to its last row."""
    own, duration = view.path.duration_s, view.log.scenario.duration_s
    planned = own if duration is None else duration
    stations = _Stations(view.path, min(planned, own))
    walk = _Walk(stations)
    for t, x, y in _places(view):
        walk.go(t, x, y)
    granted = 0.0 if walk.stood(stations.at(planned)) else LATE_S
    return PathProgress(walk.driven, stations.s[-1], stations.s[stations.at(planned - granted)])


class _Stations:
    """Points of a path from its start to the time `end` [s], about STEP_M apart, every reversal among them."""

    def __init__(self, path: Path, end: float) -> None:
        times = np.append(np.arange(0.0, end, STEP_M / path.speed_m_s), end)
        pieces: list[Array] = []
        self.cusp_times: list[float] = []
        way = 0.0
        forward: Mask = np.empty(0, dtype=bool)
        for first in range(0, len(times), PIECE):
            piece = times[max(first - 1, 0) : first + PIECE]
            points, cusps, forward = _piece(path, piece, way, forward[-1:])
            pieces.append(points[1 if first else 0 :])  # each piece begins with the end of the one before
            self.cusp_times += cusps
            way = float(points[-1, 3])
        self.times, self.x, self.y, self.s = (
            np.concatenate([points[:, column] for points in pieces]).data for column in range(4)
        )
        self.cusps = np.searchsorted(self.times, self.cusp_times).tolist()

    def at(self, t: float) -> int:
        """The last point that the reference has passed at `t` [s]."""
        return max(bisect_right(self.times, t) - 1, 0)

    def leg(self, t: float) -> tuple[int, int]:
        """First and last point between the reversals that surround the reference at `t` [s]."""
        k = bisect_right(self.cusp_times, t)
        ends = [0, *self.cusps[max(k - 1, 0) : k + 1], len(self.times) - 1] if self.cusps else [0, len(self.times) - 1]
        return (ends[0], ends[1]) if k == 0 else (ends[1], ends[2])

    def nearest(self, k: int, x: float, y: float, leg: tuple[int, int]) -> tuple[int, float]:
        """The nearest point to (x, y) [m] downhill from point `k`, on a leg, and its squared distance [m2]."""
        low, high = leg
        k = min(max(k, low), high)
        found = self._squared(k, x, y)
        for step, end in ((1, high), (-1, low)):
            while k != end and (other := self._squared(k + step, x, y)) < found:
                k, found = k + step, other
        return k, found

    def _squared(self, k: int, x: float, y: float) -> float:
        dx, dy = self.x[k] - x, self.y[k] - y
        return dx * dx + dy * dy


def _piece(path: Path, times: Array, way: float, forward: Mask) -> tuple[Array, list[float], Mask]:
    """Points (n, 4) of a path at some of these times: time [s], x, y and distance along it [m]; times of reversals [s].

    The first point is `way` [m] along the path; it and the last are always there. `forward` says whether the last move
    before, if any, was one forward; returned is that of all moves.
    """
    points = np.fromiter((path.at(time)[:5] for time in times.tolist()), dtype=(float, 5), count=len(times))
    dx, dy = np.diff(points[:, :2], axis=0).T
    s = way + np.concatenate(([0.0], np.cumsum(np.hypot(dx, dy))))
    moved = np.flatnonzero(np.diff(s) > 1e-6)
    ahead = np.concatenate((forward, (dx * np.cos(points[:-1, 4]) + dy * np.sin(points[:-1, 4]))[moved] > 0))
    cusps = moved[len(moved) + 1 - len(ahead) :][np.diff(ahead)]
    marks = np.flatnonzero(np.diff(np.floor(s / (0.99 * STEP_M)), prepend=-1.0))
    kept = np.unique(np.concatenate((marks, cusps, [len(times) - 1])))
    return np.column_stack((times, points[:, :2], s))[kept], times[cusps].tolist(), ahead


class _Walk:
    """Follows the point of a path that is nearest to a tractor, and notes which pieces it drives."""

    def __init__(self, stations: _Stations) -> None:
        self.stations, self.place, self.within = stations, 0, False
        self.pieces = bytearray(len(stations.times))
        """1 for each piece, from a point to the next, that has been driven."""
        self.t = self.driven_t = 0.0
        """Time of the last place, and of the last one up to which a piece was driven [s]."""

    def go(self, t: float, x: float, y: float) -> None:
        """Next place of the tractor, (x, y) [m] at the time `t` [s]."""
        stations, leg, last = self.stations, self.stations.leg(t), self.place
        k, squared = stations.nearest(last, x, y, leg)
        if squared > ASTRAY_M**2:
            other, beside = stations.nearest(stations.at(t), x, y, leg)
            k, squared = (other, beside) if beside < squared else (k, squared)
        within = squared <= CORRIDOR_M**2
        if within and self.within and k > last and stations.s[k] - stations.s[last] <= LEAP_M:
            self.pieces[last:k] = b"\1" * (k - last)
            self.driven_t = t
        self.t, self.place, self.within = t, k, within

    def stood(self, end: int) -> bool:
        """Whether it drove nothing at last, while the reference drove on towards point `end`."""
        s, waited = self.stations.s, self.t - self.driven_t
        return waited > LATE_S and s[end] - s[self.stations.at(self.driven_t)] > 2 * STEP_M

    @property
    def driven(self) -> float:
        """Length of the pieces that have been driven [m]."""
        return float(np.diff(self.stations.s) @ np.frombuffer(self.pieces, dtype=np.uint8)[:-1])


def _places(view: RunView) -> Iterator[tuple[float, float, float]]:
    """Time [s] and position [m] of the true CG about every STEP_M that it drives, and at the end."""
    columns = [view.column(name) for name in ("t", "x", "y")]
    for first in range(0, len(columns[0]), PIECE):
        rows = np.column_stack([column[first : first + PIECE] for column in columns])
        rows = rows[(np.abs(rows) < FARTHEST_M).all(axis=1)]
        way = np.cumsum(np.hypot(*np.diff(rows[:, 1:], axis=0, prepend=rows[:1, 1:]).T))
        kept = np.diff(np.floor(way / STEP_M), prepend=-1.0) > 0
        kept[-1:] = True
        yield from rows[kept].tolist()
