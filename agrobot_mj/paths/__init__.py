"""Reference paths: desired position and velocity of the tractor's CG as functions of time.

`base.py` defines the interface of all paths. `line`, `circle` and `figure_eight` have a constant speed after a ramp.
All other paths derive from `Timed`, which computes the speed from limits of speed and acceleration. Paths with parallel
passes derive from `Parallel`, which adds the time intervals of the passes, `passes_s`.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.base import ReferencePath
from agrobot_mj.paths.circle import Circle
from agrobot_mj.paths.contour import Contour
from agrobot_mj.paths.figure_eight import FigureEight
from agrobot_mj.paths.lane_change import LaneChange
from agrobot_mj.paths.line import Line
from agrobot_mj.paths.manoeuvre import Manoeuvre
from agrobot_mj.paths.parallel import Parallel
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.sinusoid import Sinusoid
from agrobot_mj.paths.swaths import Swaths
from agrobot_mj.paths.waypoints import Waypoints

Path = Annotated[
    Line
    | Circle
    | FigureEight
    | Swaths
    | Contour
    | Sinusoid
    | LaneChange
    | Waypoints
    | Manoeuvre,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = [
    "Circle",
    "Contour",
    "FigureEight",
    "LaneChange",
    "Line",
    "Manoeuvre",
    "Parallel",
    "Path",
    "ReferencePath",
    "Sinusoid",
    "Swaths",
    "Timed",
    "Waypoints",
    "sample",
]


def sample(path: Path, times: Array) -> Array:
    """Return the east and north coordinates of `path` at `times` (n,) [s], as an array of shape (n, 2) [m]."""
    return np.array([path.at(t)[:2] for t in np.asarray(times, dtype=float).tolist()]).reshape(-1, 2)
