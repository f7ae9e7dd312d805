"""What every reference path is: where the CG should be, and how fast it should go, at each time.

A path is data (a frozen spec) with one question, `at(t)`. A new kind is one file with a class derived from
`ReferencePath`, or from `Timed` (`profile.py`) where the speed shall follow from limits, and its name in the union
`Path` of `paths/__init__.py`.

The contract:

- `at(t)` answers for every finite `t`. Before 0 the reference stands at the start; beyond `duration_s` it goes on
  (round, or straight). It is called in every tick, so it takes microseconds: build what is expensive once.
- Position is continuous, and velocity is its derivative along the heading (backwards along it in reverse).
- The heading is continuous and turns at speed times curvature. The curvature may step, where the kind says so.
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

MOST_SAMPLES = 1000
"""Largest number of samples of an outline [-]: they take some milliseconds."""


class PathOutline(NamedTuple):
    """Samples of a path in the order of time, arrays of shape (n,); a step of the curvature is two samples."""

    t: Array
    """Time [s]."""
    x: Array
    """East [m]."""
    y: Array
    """North [m]."""
    curvature: Array
    """Left positive [1/m]."""
    speed: Array
    """Absolute speed [m/s]."""


def reference_at(path: "ReferencePath", t: float) -> Reference:
    """Reference of a path at `t` [s].

    Raises `ScenarioError` where the path returns none or one without numbers, `NotFiniteError` for NaN and infinity.
    """
    kind = getattr(path, "kind", "")
    found = check_type(path.at(t), Reference, "the path", kind, "at")
    try:
        finite = isfinite(sum(found))
    except TypeError:
        raise ScenarioError(f"the path ({kind}) returned a non-numeric reference: {one_line(found)}") from None
    if not finite:
        wrong = [f"reference.{name} is {value}" for name, value in found._asdict().items() if not isfinite(value)]
        raise NotFiniteError(f"{(wrong or ['reference overflows'])[0]}, made by the path ({kind}) at t = {t:.2f} s")
    return found


def start_of(path: "ReferencePath") -> Reference:
    """Initial pose of the tractor: the path's start, offset and turned by the keys of the path.

    Raises `ScenarioError` unless the path returns a finite reference.
    """
    r, turned = _planned(path, 0.0), radians(path.start_heading_deg)
    if not path.start_offset_m and not turned:
        return r
    x, y = r.x - path.start_offset_m * sin(r.yaw), r.y + path.start_offset_m * cos(r.yaw)
    return r._replace(x=x, y=y, yaw=wrap(r.yaw + turned))


def _planned(path: "ReferencePath", t: float) -> Reference:
    """Reference at `t` [s] before the run. Raises `ScenarioError` unless the path returns a finite one."""
    try:
        return reference_at(path, t)
    except NotFiniteError as error:
        raise ScenarioError(f"{error}; return finite numbers") from None


class ReferencePath(Spec):
    """A path; a kind gives `duration_s`, `max_curvature`, `sharpest` and `at`."""

    ends: ClassVar[bool] = False
    """Whether the path has an end, which ends the run of a tractor that has passed it; otherwise it goes round."""

    kind: str
    radius_key: ClassVar[str] = ""
    """Key of the radius of its bends; none where they follow from other keys."""
    speed_m_s: Speed = 1.2
    """Largest speed of the reference [m/s]; assumed value: 1-1.5 m/s fits the paper's 120 s a turn."""

    start_offset_m: Annotated[float, Field(ge=-20, le=20)] = 0.0
    """Distance at which the tractor starts beside the path, left positive; the reference stays on the path [m]."""
    start_heading_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    """Heading of the tractor at its start from that of the path, left positive [deg]."""

    def check(self) -> None:
        """Read the path's files. Raises ValueError, naming the key, where they give no path."""

    @property
    def duration_s(self) -> float:
        """Natural duration, that of a run on this path [s]."""
        raise NotImplementedError

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """(start, end) of each turn that metrics report separately; by default the whole path is one [s]."""
        return ((0.0, self.duration_s),)

    @property
    def max_curvature(self) -> float:
        """Largest absolute curvature [1/m]."""
        raise NotImplementedError

    @property
    def sharpest(self) -> Place:
        """First place of the largest curvature."""
        raise NotImplementedError

    def at(self, t: float) -> Reference:
        """The reference at time `t` [s] since the start."""
        raise NotImplementedError

    def outline(self) -> PathOutline:
        """The path until the end of its first turn, sampled every tick where that takes at most MOST_SAMPLES.

        Raises `ScenarioError` unless all samples are finite.
        """
        end = self.turns_s[0][1]
        times = np.linspace(0.0, end, min(max(ceil(end / TICK_S), 1), MOST_SAMPLES) + 1)
        found = np.array([_planned(self, t) for t in times.tolist()])
        x, y, vx, vy, _, curvature = found.T[:6]
        return PathOutline(times, x, y, curvature, np.hypot(vx, vy))
