"""Speed profile of a course: the maximum speed within all limits after a start from rest, and the reference state.

The limits are `speed_m_s` of the path, the maximum speed of each segment, the lateral acceleration v^2 kappa and the
acceleration along the path. The speed is zero at cusps. Between two joints the squared speed is linear in the distance,
so that the position is the exact integral of the velocity. The reference rests at the start before time 0. After the
end, it continues straight at its last speed.
"""

from bisect import bisect_right
from functools import cached_property, lru_cache
from math import sqrt
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from agrobot_mj.core.signals import Array, Reference
from agrobot_mj.paths.arc import Place, Pose, Speed, advance, reference
from agrobot_mj.paths.base import PathOutline, ReferencePath
from agrobot_mj.paths.track import Course, Mask, checked_length

Acceleration = Annotated[float, Field(ge=0.01, le=10)]


def fastest(lengths: Array, limits: Array, acceleration: float, stops: Mask | None = None) -> Array:
    """Return the maximum speeds [m/s] at the n + 1 joints of n segments of `lengths` [m], after a start from rest.

    `limits` [m/s], shape (n,), apply to whole segments. `acceleration` [m/s2] limits acceleration and deceleration. The
    speed is zero at the inner joints marked in `stops`, shape (n - 1,).
    """
    between = np.minimum(limits[:-1], limits[1:])
    if stops is not None:
        between = np.where(stops, 0.0, between)
    bounds = np.concatenate(([0.0], between, limits[-1:])) ** 2
    # The slope of v^2 over the distance is twice the acceleration. After subtraction of this slope, each limit acts
    # forward (then backward) as a running minimum.
    gained = 2 * acceleration * np.concatenate(([0.0], np.cumsum(lengths)))
    rising = np.minimum.accumulate(bounds - gained) + gained
    falling = np.minimum.accumulate((bounds + gained)[::-1])[::-1] - gained
    return np.sqrt(np.maximum(np.minimum(rising, falling), 0.0))


class TimedCourse:
    """Course with the times at which the reference passes the joints of its segments."""

    def __init__(self, course: Course, speed: float, lateral: float, acceleration: float) -> None:
        course = course.divided()
        in_bends = np.sqrt(lateral / np.maximum(course.peaks, 1e-12))
        limits = np.minimum(np.minimum(speed, course.speeds), in_bends)
        v = fastest(course.lengths, limits, acceleration, course.cusps)
        mean = np.where(course.lengths > 0, (v[:-1] + v[1:]) / 2, 1.0)  # no distance during a pause
        durations = np.where(course.lengths > 0, course.lengths / mean, course.pauses)
        self.course = course
        self.distances = course.distances()
        self.times = np.concatenate(([0.0], np.cumsum(durations)))
        self.speeds = v
        self._starts: list[float] = self.times.tolist()
        self._poses = [Pose(*pose) for pose in zip(*(part.tolist() for part in course.joints()), strict=True)]
        self._curvatures = [*course.curvatures.tolist(), 0.0]
        self._sharpnesses = [*course.sharpnesses.tolist(), 0.0]
        self._trends = [*course.trends.tolist(), 0.0]
        self._directions = [*course.directions.tolist(), float(course.directions[-1])]
        self._speeds: list[float] = v.tolist()
        self._gains = [*(np.diff(v) / durations).tolist(), 0.0]

    @property
    def duration(self) -> float:
        """Travel time from rest at the start to the end of the course [s]."""
        return self._starts[-1]

    @cached_property
    def max_curvature(self) -> float:
        """Maximum absolute curvature [1/m]."""
        return float(self.course.peaks.max())

    @cached_property
    def sharpest(self) -> Place:
        """First point of maximum curvature of the course."""
        return self.course.sharpest()

    def time_at(self, distance: float) -> float:
        """Return the time [s] at which the reference has travelled `distance` [m] along the course."""
        k = min(max(int(np.searchsorted(self.distances, distance, "right")) - 1, 0), len(self.speeds) - 2)
        offset, v, a = distance - float(self.distances[k]), self._speeds[k], self._gains[k]
        return self._starts[k] + 2 * offset / max(v + sqrt(max(v * v + 2 * a * offset, 0.0)), 1e-12)

    def outline(self) -> PathOutline:
        """Return path samples at both ends of each segment."""

        def ends(first: Array, last: Array) -> Array:
            return np.stack((first, last), 1).ravel()

        x, y, _ = self.course.joints()
        t, east, north, speed = (ends(values[:-1], values[1:]) for values in (self.times, x, y, self.speeds))
        return PathOutline(t, east, north, ends(self.course.curvatures, self.course.ends), speed)

    def at(self, t: float) -> Reference:
        """Return the reference state at time `t` [s], also before the start and after the end."""
        if t <= 0.0:
            return reference(self._poses[0], self._curvatures[0], 0.0)
        k = bisect_right(self._starts, t) - 1
        dt, v, a, direction = t - self._starts[k], self._speeds[k], self._gains[k], self._directions[k]
        driven, speed = dt * (v + a * dt / 2), direction * (v + a * dt)
        curvature, sharpness = self._curvatures[k], direction * self._sharpnesses[k]
        pose = advance(self._poses[k], curvature, direction * driven, sharpness)
        if sharpness:
            curvature += self._sharpnesses[k] * driven
        return reference(pose, curvature, speed, direction * self._trends[k])


class Timed(ReferencePath):
    """Base class of the paths whose speed is computed from limits; subclasses define `course`."""

    speed_m_s: Speed = 1.2
    """Maximum speed of the reference [m/s]. Assumed value, as for the paper's figure-eight."""
    acceleration_m_s2: Acceleration = 0.3
    """Maximum acceleration and deceleration [m/s2]. Assumed value (range 0.2-0.5) for typical drivers."""
    lateral_acceleration_m_s2: Acceleration = 0.5
    """Maximum lateral acceleration [m/s2], which limits the speed in bends. Assumed value (range 0.3-1) for comfort."""

    ends = True
    reads_file: ClassVar[bool] = False
    """Whether the course is read from a file. If so, `check` builds the course in place of the constructor."""

    @model_validator(mode="after")
    def _has_a_course(self) -> Self:
        if not self.reads_file:
            self.check()
        return self

    def check(self) -> None:
        """Build the course. Raise a ValueError that names the invalid key if the keys do not define a path."""
        checked_length(float(self.course().lengths.sum()))

    def course(self) -> Course:
        """Return the path geometry without its timing. Raise ValueError if the keys do not define a path."""
        raise NotImplementedError

    @property
    def motion(self) -> TimedCourse:
        """Course with the times at which the reference passes its joints (cached)."""
        return _motion(self)

    @property
    def duration_s(self) -> float:
        """Travel time from rest at the start to the end of the path [s]."""
        return self.motion.duration

    @property
    def max_curvature(self) -> float:
        """Maximum absolute curvature [1/m]."""
        return self.motion.max_curvature

    @property
    def sharpest(self) -> Place:
        """First point of maximum curvature."""
        return self.motion.sharpest

    def outline(self) -> PathOutline:
        """Return path samples at both ends of each segment."""
        return self.motion.outline()

    def at(self, t: float) -> Reference:
        """Return the reference state at time `t` [s]; the reference continues straight after the end."""
        return _motion(self).at(t)


@lru_cache(maxsize=16)
def _motion(path: Any) -> TimedCourse:
    limits = path.speed_m_s, path.lateral_acceleration_m_s2, path.acceleration_m_s2
    return TimedCourse(path.course(), *limits)
