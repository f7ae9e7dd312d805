"""Sinusoid about a straight axis: y = A sin(2 pi x / wavelength), with x along the axis and y to the left.

The path starts on the axis with zero curvature and a heading to the left of the axis (to the right for a negative
amplitude). The curvature is continuous.
"""

from math import pi, radians
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from agrobot_mj.core.spec import HUGE, Positive
from agrobot_mj.paths.parallel import Coordinate
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.track import Course, course_along, samples


class Sinusoid(Timed):
    """Sinusoidal path with a whole number of waves."""

    kind: Literal["sinusoid"] = "sinusoid"
    amplitude_m: Annotated[float, Field(ge=-HUGE, le=HUGE)] = 2.0
    """Amplitude [m], positive if the first crest is on the left. Assumed value; the minimum bend radius is 11.4 m."""
    wavelength_m: Positive = 30.0
    """Wavelength along the axis [m]. Assumed value; the minimum bend radius is 11.4 m with the default amplitude."""
    count: Annotated[int, Field(ge=1, le=1000)] = 4
    """Number of waves [-]. Assumed value, which gives a total length of 120 m."""
    heading_deg: float = 0.0
    """Direction of the axis [deg], counter-clockwise from east."""
    start_x_m: Coordinate = 0.0
    """East coordinate of the start [m]."""
    start_y_m: Coordinate = 0.0
    """North coordinate of the start [m]."""

    def course(self) -> Course:
        """Return the geometry of the path along all waves."""
        A, k, end = self.amplitude_m, 2 * pi / self.wavelength_m, self.wavelength_m * self.count
        x = np.linspace(0.0, end, max(samples(end + 4 * abs(A) * self.count), 64 * self.count + 1))
        start = self.start_x_m, self.start_y_m, radians(self.heading_deg)
        return course_along(start, x, A * np.sin(k * x), A * k * np.cos(k * x))
