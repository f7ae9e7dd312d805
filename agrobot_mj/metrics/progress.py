"""Progress: how much of the path the tractor drove, and whether that is enough to call the path driven.

The path is that of the reference until the planned end of the run, or to its own end if that comes first. A piece of
it is driven by moving along it within CORRIDOR_M. The nearest point is followed from place to place of the tractor, see
`paths.route`, so that neither the other branch of a crossing, nor another lap or the neighbouring swath is taken for
it. A tractor that has strayed from that point is also sought beside the reference. What the nearest point leaps over is
not driven: a tractor that stands still drives nothing, wherever the reference goes.

Guidance that follows no path is to drive as far as its speed commands add up to.
"""

from collections.abc import Iterator
from math import hypot
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.core.long_array import PIECE
from agrobot_mj.core.signals import Array, Column
from agrobot_mj.metrics.base import Metric, RunView
from agrobot_mj.metrics.crosstrack import FARTHEST_M
from agrobot_mj.paths.route import SampledRoute

CORRIDOR_M = 5.0
"""Distance from the path within which it counts as driven [m]. Assumed value: two swaths; errors say the rest."""
ENOUGH = 0.9
"""Least share of the path that must be driven [-]. Assumed value."""
LATE_S = 2.0
"""Delay behind the reference that a moving tractor is allowed at the end [s]. Assumed value: it starts from rest."""
STEP_M = 0.25
"""Spacing of the places of the tractor that are looked at; a path has a share from this length on [m]."""
ASTRAY_M = 1.0
"""Distance from the path at which the tractor is also sought beside the reference [m]."""
LEAP_M = 1.5
"""Longest piece of the path that is driven between two places: in a bend, the tractor inside, more than STEP_M [m]."""


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
        """Metric from `progress_of`."""
        return {"progress": progress_of(view).share}


def progress_of(view: RunView) -> PathProgress:
    """How much of the path of a run was driven, up to its last row."""
    own, duration = view.path.duration_s, view.log.scenario.duration_s
    planned = own if duration is None else duration
    walk = _Walk(view.route, min(planned, own))
    for t, x, y in _places(view):
        walk.go(t, x, y)
    granted = 0.0 if walk.stood(planned) else LATE_S
    return PathProgress(walk.driven, walk.passed(planned), walk.passed(planned - granted))


def commanded_progress(view: RunView) -> PathProgress:
    """Distance along the heading over the one that the speed commands add up to: for guidance without a path."""
    t, asked, speed = (np.nan_to_num(view.column(name)) for name in ("t", "speed_ref", "speed"))
    steps = np.diff(t, append=t[-1:])
    due = t < t[-1] - LATE_S if len(t) else t
    return PathProgress(*(float(np.sum(np.abs(each) * steps)) for each in (speed, asked, asked * due)))


class _Walk:
    """Follows the point of a path, until the time `end` [s], that is nearest to a tractor; notes what it drives."""

    def __init__(self, route: SampledRoute, end: float) -> None:
        self.route, self.place, self.within, self.last = route, 0, False, route.number_at(end)
        self.pieces = bytearray(self.last)
        """1 for each piece, from a sample of the route to the next, that has been driven."""
        self.t = self.driven_t = 0.0
        """Time of the last place, and of the one from which a piece was last driven [s]."""

    def go(self, t: float, x: float, y: float) -> None:
        """Next place of the tractor, (x, y) [m] at the time `t` [s]."""
        before = self.route.distances[self.place]
        k, apart = self._nearest(t, x, y, before)
        if apart > ASTRAY_M:
            other, beside = self._nearest(t, x, y, self.passed(t))
            k, apart = (other, beside) if beside < apart else (k, apart)
        within = apart <= CORRIDOR_M
        if within and self.within and k > self.place and self.route.distances[k] - before <= LEAP_M:
            self.pieces[self.place : k] = b"\1" * (k - self.place)
            self.driven_t = self.t
        self.t, self.place, self.within = t, k, within

    def _nearest(self, t: float, x: float, y: float, near: float) -> tuple[int, float]:
        """The sample nearest to (x, y) [m], sought about the distance `near` [m], and how far it is [m].

        It is the last one from STEP_M before that on.
        """
        k, _ = self.route.search(x, y, near, t)
        if self.route.distances[k] > self.route.distances[self.last] - STEP_M:
            k = self.last
        sample = self.route.sample(k)
        return k, hypot(x - sample.x, y - sample.y)

    def passed(self, t: float) -> float:
        """Length that the reference has passed at `t` [s], at most that of the path [m]."""
        k = min(self.route.number_at(t), self.last)
        return float(self.route.distances[k])

    def stood(self, end: float) -> bool:
        """Whether it drove nothing at last, while the reference drove on until `end` [s]."""
        waited = self.t - self.driven_t
        return waited > LATE_S and self.passed(end) - self.passed(self.driven_t) > 2 * STEP_M

    @property
    def driven(self) -> float:
        """Length of the pieces that have been driven [m]."""
        return float(np.diff(self.route.distances[: self.last + 1]) @ np.frombuffer(self.pieces, dtype=np.uint8))


def _places(view: RunView) -> Iterator[list[float]]:
    """Time [s] and position [m] of the true CG about every STEP_M that it drives, and at the end."""
    columns, way, end, told = [view.column(name) for name in ("t", "x", "y")], -STEP_M, np.empty((0, 3)), True
    for first in range(0, len(columns[0]), PIECE):  # a day's rows at once would take 100 MB
        rows: Array = np.column_stack([column[first : first + PIECE] for column in columns])
        rows = rows[(np.abs(rows) < FARTHEST_M).all(axis=1)]
        if len(rows):
            steps = np.diff(np.concatenate([end if len(end) else rows[:1], rows])[:, 1:], axis=0)
            ways = max(way, 0.0) + np.cumsum(np.hypot(*steps.T))
            kept = np.diff(np.floor(ways / STEP_M), prepend=np.floor(way / STEP_M)) > 0
            yield from rows[kept].tolist()
            way, end, told = float(ways[-1]), rows[-1:], bool(kept[-1])
    if not told:
        yield from end.tolist()
