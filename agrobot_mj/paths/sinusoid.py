"""A sinusoid about a straight axis: y = A sin(2 pi x / wavelength), x along the axis.

It begins on the axis, where its curvature is zero, heading to the left of the axis (to the right if the amplitude is
negative). The curvature changes smoothly all along.
"""

from math import pi, radians
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from agrobot_mj.core.spec import HUGE, Positive
from agrobot_mj.paths.parallel import Coordinate
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.track import Course, placed, samples


class Sinusoid(Timed):
    """Whole waves of a sinusoid."""

    kind: Literal["sinusoid"] = "sinusoid"
    amplitude_m: Annotated[float, Field(ge=-HUGE, le=HUGE)] = 2.0
    """Height of a crest over the axis, positive if the first is to the left [m]. Assumed value: bends of 11.4 m
    radius."""
    wavelength_m: Positive = 30.0
    """Length of a wave along the axis [m]. Assumed value: with the amplitude, bends of 11.4 m radius."""
    count: Annotated[int, Field(ge=1, le=1000)] = 4
    """Number of waves [-]; assumed value: 120 m."""
    heading_deg: float = 0.0
    """Direction of the axis from east, counter-clockwise [deg]."""
    start_x_m: Coordinate = 0.0
    """Start, east [m]."""
    start_y_m: Coordinate = 0.0
    """Start, north [m]."""

    def course(self) -> Course:
        """All waves."""
        A, k, end = self.amplitude_m, 2 * pi / self.wavelength_m, self.wavelength_m * self.count
        x = np.linspace(0.0, end, max(samples(end + 4 * abs(A) * self.count), 64 * self.count + 1))
        start = self.start_x_m, self.start_y_m, radians(self.heading_deg)
        return placed(start, x, A * np.sin(k * x), A * k * np.cos(k * x))
