"""Speed profile of a course: the maximum speed within all limits after a start from rest, and the reference state.

The limits are `speed_m_s` of the path, the maximum speed of each segment, the lateral acceleration v^2 kappa and the
acceleration along the path. The speed is zero at cusps. Between two joints (segment ends) the squared speed is linear
in the distance, so that the position is the exact integral of the velocity. The reference rests at the start before
time 0. After the end, it continues straight at its last speed.
"""

from bisect import bisect_right
from functools import cached_property, lru_cache
from math import sqrt
from typing import Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from agrobot_mj.core.kernels import shared, stage
from agrobot_mj.core.samples import write_reference
from agrobot_mj.core.signals import Array, Matrix, Reference, Vector
from agrobot_mj.paths.arc import Place, Pose, Speed, reference, reference_along
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


class _Joint(NamedTuple):
    """Start of a segment of a `TimedCourse`, or the end of the course, with the motion of the reference."""

    t: float  # Time at which the reference passes the start of the segment [s]
    x: float  # East coordinate [m]
    y: float  # North coordinate [m]
    yaw: float  # Heading [rad], not wrapped
    curvature: float  # Curvature at the start of the segment [1/m]
    sharpness: float  # Change of curvature per metre travelled on the segment [1/m2]
    trend: float  # Change of curvature per metre [1/m2] of the curve that the segment approximates
    direction: float  # Direction of travel: 1 forward, -1 reverse [-]
    speed: float  # Absolute speed at the start of the segment [m/s]
    gain: float  # Acceleration on the segment [m/s2]


@shared
def _reference_on_segment(joint: _Joint, t: float) -> Reference:
    """Return the reference state at time `t` [s] on the segment of a course that starts at `joint`."""
    dt, direction = t - joint.t, joint.direction
    driven, speed = dt * (joint.speed + joint.gain * dt / 2), direction * (joint.speed + joint.gain * dt)
    start, sharpness = Pose(joint.x, joint.y, joint.yaw), direction * joint.sharpness
    return reference_along(start, joint.curvature, sharpness, direction * driven, speed, direction * joint.trend)


@stage
def _references(joints: Matrix, times: Vector) -> Matrix:
    references = np.empty((times.size, 7))
    for n, t in enumerate(times):
        j = joints[np.searchsorted(joints[:, 0], t, "right") - 1]
        joint = _Joint(j[0], j[1], j[2], j[3], j[4], j[5], j[6], j[7], j[8], j[9])
        write_reference(references, n, _reference_on_segment(joint, t))
    return references


class TimedCourse:
    """Course with the times at which the reference passes the ends of the segments."""

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
        last = course.directions[-1]
        ahead = course.curvatures, course.sharpnesses, course.trends, np.diff(v) / durations
        curvatures, sharpnesses, trends, gains = (np.append(values, 0.0) for values in ahead)
        motion = np.append(course.directions, last), v, gains
        self.joints = np.column_stack((self.times, *course.joints(), curvatures, sharpnesses, trends, *motion))
        self._starts: list[float] = self.times.tolist()

    @property
    def duration(self) -> float:
        """Travel time from rest at the start to the end of the course [s]."""
        return self._starts[-1]

    @cached_property
    def max_curvature(self) -> float:
        """Maximum absolute curvature of the course [1/m]."""
        return float(self.course.peaks.max())

    @cached_property
    def sharpest(self) -> Place:
        """First point of maximum absolute curvature of the course."""
        return self.course.sharpest()

    def time_at(self, distance: float) -> float:
        """Return the time [s] at which the reference has travelled `distance` [m] along the course."""
        k = min(max(int(np.searchsorted(self.distances, distance, "right")) - 1, 0), len(self.speeds) - 2)
        offset, v, a = distance - float(self.distances[k]), *self._joint(k)[-2:]
        return self._starts[k] + 2 * offset / max(v + sqrt(max(v * v + 2 * a * offset, 0.0)), 1e-12)

    def outline(self) -> PathOutline:
        """Return points of the course at both ends of each segment."""

        def ends(first: Array, last: Array) -> Array:
            return np.stack((first, last), 1).ravel()

        x, y, _ = self.course.joints()
        t, east, north, speed = (ends(values[:-1], values[1:]) for values in (self.times, x, y, self.speeds))
        return PathOutline(t, east, north, ends(self.course.curvatures, self.course.ends), speed)

    def at(self, t: float) -> Reference:
        """Return the reference state at time `t` [s], at rest before the start and straight ahead after the end."""
        if t <= 0.0:
            first = self._joint(0)
            return reference(Pose(first.x, first.y, first.yaw), first.curvature, 0.0)
        return _reference_on_segment(self._joint(bisect_right(self._starts, t) - 1), t)

    def _joint(self, k: int) -> _Joint:
        return _Joint(*self.joints[k].tolist())


class Timed(ReferencePath):
    """Base class of paths whose speed is computed from speed and acceleration limits; subclasses define `course`."""

    speed_m_s: Speed = 1.2
    """Maximum speed of the reference [m/s]. Assumed value, equal to the speed of the paper."""
    acceleration_m_s2: Acceleration = 0.3
    """Maximum acceleration and deceleration [m/s2]. Assumed value (range 0.2-0.5) for typical drivers."""
    lateral_acceleration_m_s2: Acceleration = 0.5
    """Maximum lateral acceleration [m/s2], which limits the speed in bends. Assumed value (range 0.3-1) for comfort."""

    ends = True
    reads_file: ClassVar[bool] = False
    """Whether the path geometry is read from a file. If so, `check` builds the geometry in place of the constructor."""

    @model_validator(mode="after")
    def _check_course(self) -> Self:
        if not self.reads_file:
            self.check()
        return self

    def check(self) -> None:
        """Build the path geometry. Raise a ValueError that names the invalid key if the keys do not define a path."""
        checked_length(float(self.course().lengths.sum()))

    def course(self) -> Course:
        """Return the geometry of the path without times. Raise ValueError if the keys do not define a path."""
        raise NotImplementedError

    @property
    def motion(self) -> TimedCourse:
        """Course with the times at which the reference passes the ends of the segments (cached)."""
        return _motion(self)

    @property
    def duration_s(self) -> float:
        """Travel time from rest at the start to the end of the path [s]."""
        return self.motion.duration

    @property
    def max_curvature(self) -> float:
        """Maximum absolute curvature of the path [1/m]."""
        return self.motion.max_curvature

    @property
    def sharpest(self) -> Place:
        """First point of maximum absolute curvature on the path."""
        return self.motion.sharpest

    def outline(self) -> PathOutline:
        """Return samples of the path at both ends of each segment."""
        return self.motion.outline()

    def at(self, t: float) -> Reference:
        """Return the reference state at time `t` [s]; the reference continues straight after the end."""
        return _motion(self).at(t)

    def _references_at(self, times: Vector) -> Matrix:
        return _references(_motion(self).joints, times)


@lru_cache(maxsize=16)
def _motion(path: Any) -> TimedCourse:
    limits = path.speed_m_s, path.lateral_acceleration_m_s2, path.acceleration_m_s2
    return TimedCourse(path.course(), *limits)
