"""Interface of the reference paths: desired position and velocity of the CG as functions of time.

A path is a frozen configuration object with the method `at(t)`. To add a path kind, write a file with a class derived
from `ReferencePath`, or from `Timed` (`profile.py`) for a speed computed from limits. Add its name to the union `Path`
in `paths/__init__.py`.

Requirements:

- `at(t)` returns a reference state for every finite `t`. Before 0 the reference rests at the start; after `duration_s`
it continues on the next lap or straight ahead. `at` runs in every tick and must take microseconds.
- The position is continuous, and the velocity is its derivative along the heading (negative in reverse).
- The heading is continuous; its rate is speed times curvature. The curvature may have steps if the path documents them.
"""

from math import ceil, cos, isfinite, radians, sin
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.core.contracts import check_type, one_line
from agrobot_mj.core.errors import NotFiniteError, ScenarioError
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import TICK_S, Array, Reference
from agrobot_mj.core.spec import Spec
from agrobot_mj.paths.arc import Place, Speed

MAX_SAMPLES = 1000  # Maximum number of samples of an outline [-], computed in a few milliseconds


class PathOutline(NamedTuple):
    """Samples of a path in order of time; each array has shape (n,). Two samples at the same point represent a step of
    the curvature."""

    t: Array  # Time of each sample [s]
    x: Array  # East coordinate of each sample [m]
    y: Array  # North coordinate of each sample [m]
    curvature: Array  # Curvature at each sample [1/m], positive to the left
    speed: Array  # Absolute speed at each sample [m/s]


def reference_at(path: "ReferencePath", t: float) -> Reference:
    """Return the reference state of a path at time `t` [s]. Raise an error if the state is not a finite `Reference`."""
    kind = getattr(path, "kind", "")
    found = check_type(path.at(t), Reference, "the path", kind, "at")
    try:
        finite = isfinite(sum(found))
    except TypeError:
        raise ScenarioError(f"the path ({kind}) returned a non-numeric reference: {one_line(found)}") from None
    if not finite:
        wrong = [f"reference.{name} is {value}" for name, value in found._asdict().items() if not isfinite(value)]
        raise NotFiniteError(
            f"the path ({kind}) at t = {t:.2f} s: {(wrong or ['the sum of the reference values overflows'])[0]}"
        )
    return found


def start_of(path: "ReferencePath") -> Reference:
    """Return the reference state at the start, shifted by `start_offset_m` and rotated by `start_heading_deg` to the
    initial pose of the tractor."""
    r, turned = _checked_reference(path, 0.0), radians(path.start_heading_deg)
    if not path.start_offset_m and not turned:
        return r
    x, y = r.x - path.start_offset_m * sin(r.yaw), r.y + path.start_offset_m * cos(r.yaw)
    return r._replace(x=x, y=y, yaw=wrap(r.yaw + turned))


def _checked_reference(path: "ReferencePath", t: float) -> Reference:
    try:
        return reference_at(path, t)
    except NotFiniteError as error:
        raise ScenarioError(f"{error}; return finite numbers") from None


class ReferencePath(Spec):
    """Base class of reference paths; subclasses define `duration_s`, `max_curvature`, `sharpest` and `at`."""

    ends: ClassVar[bool] = False
    """Whether a run ends at the end of the path. If false, the path continues, for example with another lap."""

    kind: str
    radius_key: ClassVar[str] = ""
    """Name of the configuration key that sets the bend radius, or an empty string if there is no such key."""
    speed_m_s: Speed = 1.2
    """Maximum speed of the reference [m/s]. Assumed value (range 1-1.5), which gives the paper's 120 s per lap."""

    start_offset_m: Annotated[float, Field(ge=-20, le=20)] = 0.0
    """Initial lateral offset of the tractor [m], positive to the left of the path; the reference stays on the path."""
    start_heading_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    """Initial heading of the tractor relative to the path [deg], positive to the left."""

    def check(self) -> None:
        """Read the files of the path. Raise a ValueError that names the invalid key if the files define no path."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about changes to the data read from a path file, such as omitted points."""
        return ()

    @property
    def duration_s(self) -> float:
        """Default duration of a run on this path [s]."""
        raise NotImplementedError

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """Start and end times of each lap [s], for metrics per lap. By default the complete path is one lap."""
        return ((0.0, self.duration_s),)

    @property
    def max_curvature(self) -> float:
        """Maximum absolute curvature of the path [1/m]."""
        raise NotImplementedError

    @property
    def sharpest(self) -> Place:
        """First point of maximum absolute curvature on the path."""
        raise NotImplementedError

    def at(self, t: float) -> Reference:
        """Return the reference state at time `t` [s] since the start."""
        raise NotImplementedError

    def outline(self) -> PathOutline:
        """Return samples of the first lap of the path: one per tick, but at most MAX_SAMPLES."""
        end = self.turns_s[0][1]
        times = np.linspace(0.0, end, min(max(ceil(end / TICK_S), 1), MAX_SAMPLES) + 1)
        found = np.array([_checked_reference(self, t) for t in times.tolist()])
        x, y, vx, vy, _, curvature = found.T[:6]
        return PathOutline(times, x, y, curvature, np.hypot(vx, vy))
