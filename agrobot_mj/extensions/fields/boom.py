"""Implement with sections: switching of the sections along a plan, and the ground that the sections work.

As in section control of guidance terminals, sections are switched by the position of the implement along the plan. When
the position, extrapolated by a look-ahead time, reaches the start or end of a pass, a command is sent, which takes
effect after a delay. At constant speed, a look-ahead time equal to the delay compensates the delay.
"""

from collections.abc import Iterator
from itertools import groupby
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.signals import Array

THIN_M, THIN_RAD = 0.5, 0.02  # Minimum distance [m] or heading change [rad] between edge points of a worked area
Times = tuple[float, float]


class Boom(NamedTuple):
    """Working width, sections and section control of an implement."""

    width: float  # Working width [m]
    sections: int = 1  # Number of equal sections
    on_delay: float = 0.0  # Delay from the switch-on command until a section works [s]
    off_delay: float = 0.0  # Delay from the switch-off command until a section stops working [s]
    on_ahead: float = 0.0  # Look-ahead time of the switch-on command [s]
    off_ahead: float = 0.0  # Look-ahead time of the switch-off command [s]

    def edges(self, section: int) -> tuple[float, float]:
        """Return the lateral offsets of the left and right edges of a section [m], positive to the left.

        Sections are numbered from the left.
        """
        each = self.width / self.sections
        return self.width / 2 - section * each, self.width / 2 - (section + 1) * each


class ImplementMotion(NamedTuple):
    """Trajectory of the working point of the implement, as arrays of shape (n,)."""

    t: Array  # Time [s]
    x: Array  # East coordinate [m]
    y: Array  # North coordinate [m]
    yaw: Array  # Heading of the implement [rad], without jumps of full turns
    s: Array  # Arc length on the plan at the position of the implement [m], as estimated by the guidance computer

    def at(self, times: Array) -> "ImplementMotion":
        """Return the trajectory at `times` [s] by linear interpolation between its samples."""
        return ImplementMotion(times, *(np.interp(times, self.t, values) for values in self[1:]))

    def between(self, start: float, end: float) -> "ImplementMotion":
        """Return the trajectory from `start` to `end` [s], with fewer points for use as corners of a polygon."""
        first, last = np.searchsorted(self.t, [start, end], "right")
        near = ImplementMotion(*(values[max(first - 1, 0) : last + 1] for values in self))
        inner = self.t[first:last]
        part = near.at(np.unique(np.concatenate(([start], inner[(inner > start) & (inner < end)], [end]))))
        travelled = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(part.x), np.diff(part.y)))))
        turned = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(part.yaw)))))
        marks = np.floor(travelled / THIN_M) + np.floor(turned / THIN_RAD)
        kept = np.concatenate(([True], np.diff(marks) > 0))
        kept[-1] = True
        return ImplementMotion(*(values[kept] for values in part))


def switching_times(motion: ImplementMotion, span: tuple[float, float], rows: slice, boom: Boom) -> Times | None:
    """Return the times at which a section starts and stops working on a pass [s], or None if it does not work.

    `span` contains the ends of the pass along the plan [m]; `rows` selects the samples of `motion` near the pass.
    """
    t, s = motion.t[rows], motion.s[rows]
    if len(t) < 2 or span[1] <= span[0]:
        return None
    speed = np.gradient(s, t)
    on = _time_of_distance(t, np.maximum.accumulate(s + speed * boom.on_ahead), span[0]) + boom.on_delay
    off = _time_of_distance(t, np.maximum.accumulate(s + speed * boom.off_ahead), span[1]) + boom.off_delay
    end = min(off, float(t[-1]))
    return (max(on, float(t[0])), end) if end > on else None


def _time_of_distance(t: Array, s: Array, distance: float) -> float:
    """Return the time at which the increasing arc length `s` reaches `distance` [m], or infinity if it never does."""
    k = int(np.searchsorted(s, distance))
    if k == len(s):
        return float("inf")
    if k == 0:
        return float(t[0])
    return float(t[k - 1] + (t[k] - t[k - 1]) * (distance - s[k - 1]) / (s[k] - s[k - 1]))


def worked_area(motion: ImplementMotion, times: list[Times | None], boom: Boom) -> BaseGeometry:
    """Return the ground worked in one pass. `times` contains the working interval of each section [s], or None for a
    section without work."""
    parts = []
    for together, group in groupby(enumerate(times), key=lambda each: each[1]):
        if together is not None:
            numbers = [number for number, _ in group]
            left, right = boom.edges(numbers[0])[0], boom.edges(numbers[-1])[1]
            parts.append(swept_area(motion.between(*together), left, right))
    return shapely.union_all(parts)


def swept_area(part: ImplementMotion, left: float, right: float) -> BaseGeometry:
    """Return the ground swept by a bar between the lateral offsets `left` and `right` of the working point [m],
    positive to the left."""
    edges = [np.column_stack([part.x - np.sin(part.yaw) * d, part.y + np.cos(part.yaw) * d]) for d in (left, right)]
    return strip(*edges)


def strip(left: Array, right: Array) -> BaseGeometry:
    """Return the area between two edges with points of shape (n, 2) [m], also if the edges cross."""
    outline = shapely.polygons(np.concatenate([left, right[::-1]]))
    if shapely.is_valid(outline):
        return outline
    quads = shapely.polygons(np.stack(list(_quads(left, right)), axis=1))
    bad = ~shapely.is_valid(quads)
    quads[bad] = shapely.convex_hull(quads[bad])
    return shapely.union_all(quads[shapely.area(quads) > 0.0])


def _quads(left: Array, right: Array) -> Iterator[Array]:
    yield from (left[:-1], left[1:], right[1:], right[:-1])
