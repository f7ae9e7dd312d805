"""Reference paths: where the CG should be, and how fast it should go, at each time.

Every member of `Path` has `at(t) -> Reference`, `speed_m_s` (constant), `duration_s` (its natural duration),
`turns_s` (start and end of each turn) and `max_curvature`. `at` goes on beyond both ends of the duration.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from agrobot_mj.paths.circle import Circle
from agrobot_mj.paths.figure_eight import FigureEight
from agrobot_mj.paths.line import Line
from agrobot_mj.signals import Array

__all__ = ["Circle", "FigureEight", "Line", "Path", "sample"]

Path = Annotated[Line | Circle | FigureEight, Field(discriminator="kind")]


def sample(path: Path, times: Array) -> Array:
    """The points of `path` at `times` (n,) [s], shape (n, 2), east and north [m]."""
    return np.array([path.at(t)[:2] for t in np.asarray(times, dtype=float).tolist()]).reshape(-1, 2)
