"""Smooth obstacles: a row of bumps under a wheel track, or bumps scattered over the field.

At the distances a along and b across its heading from its centre, a bump of length l and width w has the height

    h = height cos^2(pi a / l) cos^2(pi b / w),     |a| < l / 2, |b| < w / 2.

Where bumps overlap, the height is the maximum of their heights, or the minimum in the case of pits.
"""

from math import ceil, cos, pi, radians, sin
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Positive
from agrobot_mj.terrain.generated import Generated

Bump = tuple[float, float, float]  # Centre (x, y) [m] and heading [rad] of a bump


class Bumps(Generated):
    """Terrain with bumps or pits of equal size on level or tilted ground."""

    VERTICAL: ClassVar[str] = "height_m"

    kind: Literal["bumps"] = "bumps"
    height_m: Annotated[float, Field(ge=-2, le=2)] = 0.1
    """Height of a bump [m], negative for a pit. Assumed value (range 0.05-0.2 for clods and stones; pits down to
    -0.3)."""
    length_m: Positive = 1.0
    """Length of a bump along its heading [m]. Assumed value (range 0.5-2)."""
    width_m: Positive = 0.8
    """Width of a bump across its heading [m]. Assumed value (range 0.4-4): wider than a tyre."""
    count: Annotated[int, Field(ge=1, le=10_000)] = 10
    """Number of bumps [-]."""
    layout: Literal["row", "scattered"] = "row"
    """Arrangement of the bumps: `row` with regular spacing, or `scattered` at random positions and headings."""
    x_m: float = 5.0
    """East coordinate of the centre of the first bump in a row [m]."""
    y_m: float = -0.5
    """North coordinate of the centre of the first bump in a row [m]. Default: right wheel track of an eastward path."""
    heading_deg: float = 0.0
    """Direction of the row and of the length of each bump in the row [deg], counter-clockwise from east."""
    spacing_m: Positive = 3.0
    """Distance between the centres of bumps in a row [m]; with 1.4, both axles rise at the same time. Assumed value
    (range 2-10)."""
    stagger_m: float = 0.0
    """Lateral offset of every second bump in a row [m], positive to the left, for alternating wheel tracks."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of the positions and headings of scattered bumps."""

    def finest(self) -> float:
        """Return the maximum node spacing [m] for at least five nodes along the length and the width of each bump."""
        return min(self.length_m, self.width_m) / 4

    def bare(self, x: Array, y: Array) -> Array:
        """Return the heights of the bumps above level ground [m]. Raises ValueError if a bump is outside the field."""
        heights = np.zeros((y.size, x.size))
        for bump in self.places():
            _raise(heights, (x, y), bump, (self.length_m, self.width_m))
        return self.height_m * heights

    def places(self) -> list[Bump]:
        """Return the centre (x, y) [m] and the heading [rad] of every bump."""
        return self._scatter() if self.layout == "scattered" else self._row()

    def _scatter(self) -> list[Bump]:
        rng = stream(self.seed, "terrain.bumps")
        half = np.array(self.half_sizes)
        places = rng.uniform(-half, half, (self.count, 2))
        return [(x, y, h) for (x, y), h in zip(places.tolist(), rng.uniform(0, pi, self.count).tolist(), strict=True)]

    def _row(self) -> list[Bump]:
        heading, found = radians(self.heading_deg), []
        half_x, half_y = self.half_sizes
        for k in range(self.count):
            along, left = k * self.spacing_m, (k % 2) * self.stagger_m
            x = self.x_m + along * cos(heading) - left * sin(heading)
            y = self.y_m + along * sin(heading) + left * cos(heading)
            if abs(x) > half_x or abs(y) > half_y:
                raise ValueError(
                    f"count: bump {k + 1} of the row is at ({x:.1f}, {y:.1f}) m, outside the field; "
                    f"set count to {k} or less, or make the field larger"
                    if k
                    else f"x_m: the first bump is at ({x:.1f}, {y:.1f}) m, outside the field; move it"
                )
            found.append((x, y, heading))
        return found


def _raise(heights: Array, nodes: tuple[Array, Array], bump: Bump, size: tuple[float, float]) -> None:
    """Raise `heights` to a bump of unit height where the bump is higher. `size` is the length and width of the bump
    [m], and `nodes` the coordinates of columns and rows of `heights` [m]."""
    x, y, heading = bump
    reach = np.hypot(*size) / 2
    column, row = (_between(along, c - reach, c + reach) for along, c in zip(nodes, (x, y), strict=True))
    dx, dy = nodes[0][None, column] - x, nodes[1][row, None] - y
    a = (cos(heading) * dx + sin(heading) * dy) / size[0]
    b = (cos(heading) * dy - sin(heading) * dx) / size[1]
    shape = (np.cos(pi * np.clip(a, -0.5, 0.5)) * np.cos(pi * np.clip(b, -0.5, 0.5))) ** 2
    np.maximum(heights[row, column], shape, out=heights[row, column])


def _between(nodes: Array, low: float, high: float) -> slice:
    step = (nodes[-1] - nodes[0]) / (nodes.size - 1)
    return slice(max(0, ceil((low - nodes[0]) / step)), max(0, ceil((high - nodes[0]) / step)))
