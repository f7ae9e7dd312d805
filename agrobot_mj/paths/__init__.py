"""Reference paths: where the CG should be, and how fast it should go, at each time.

Every member of `Path` has `at(t) -> Reference`, `speed_m_s` (the largest), `duration_s` (its natural duration),
`turns_s` (start and end of each turn), `max_curvature` and `sharpest` (where that is). `at` goes on beyond both ends of
the duration. The speed of `line`, `circle` and `figure_eight` is constant after a ramp; that of the others (`Timed`)
keeps to limits. A `Parallel` also has `passes_s`.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.circle import Circle
from agrobot_mj.paths.contour import Contour
from agrobot_mj.paths.figure_eight import FigureEight
from agrobot_mj.paths.lane_change import LaneChange
from agrobot_mj.paths.line import Line
from agrobot_mj.paths.parallel import Parallel
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.sinusoid import Sinusoid
from agrobot_mj.paths.swaths import Swaths
from agrobot_mj.paths.waypoints import Waypoints

__all__ = ["Circle", "Contour", "FigureEight", "LaneChange", "Line", "Parallel", "Path", "Sinusoid", "Swaths", "Timed"]
__all__ += ["Waypoints", "sample"]

Path = Annotated[
    Line | Circle | FigureEight | Swaths | Contour | Sinusoid | LaneChange | Waypoints, Field(discriminator="kind")
]


def sample(path: Path, times: Array) -> Array:
    """The points of `path` at `times` (n,) [s], shape (n, 2), east and north [m]."""
    return np.array([path.at(t)[:2] for t in np.asarray(times, dtype=float).tolist()]).reshape(-1, 2)
