"""Smooth obstacles: a row of bumps under a wheel track, or bumps scattered over the field.

One bump of length l along its heading and width w across is

    h = height cos^2(pi a / l) cos^2(pi b / w),     |a| < l / 2, |b| < w / 2,

which has no edge. Where bumps overlap the higher one counts (of pits the deeper one).
"""

from math import ceil, cos, pi, radians, sin
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Positive
from agrobot_mj.terrain.generated import Generated

Bump = tuple[float, float, float]
"""Centre x, y [m] and heading [rad]."""


class Bumps(Generated):
    """Bumps or pits of one size."""

    VERTICAL: ClassVar[str] = "height_m"

    kind: Literal["bumps"] = "bumps"
    height_m: Annotated[float, Field(ge=-2, le=2)] = 0.1
    """Of a bump; negative for a pit [m]. Estimate: a clod or a stone; 0.05-0.2."""
    length_m: Positive = 1.0
    """Of a bump, along its heading [m]. Estimate: 0.5-2."""
    width_m: Positive = 0.8
    """Of a bump, across [m]. Estimate: wider than a tyre; 0.4-4."""
    count: Annotated[int, Field(ge=1, le=10_000)] = 10
    """How many there are."""
    layout: Literal["row", "scattered"] = "row"
    """A regular row, or places and headings drawn from `seed`."""
    x_m: float = 5.0
    """Centre of the first bump of a row, east [m]."""
    y_m: float = -0.5
    """Likewise, north [m]. The default lies under the right wheels of a tractor that drives east from the origin."""
    heading_deg: float = 0.0
    """Of a row and of its bumps, from east, counter-clockwise [deg]."""
    spacing_m: Positive = 3.0
    """Between the centres of a row [m]. Estimate: 2-10."""
    stagger_m: float = 0.0
    """Every second bump of a row lies as far to the left; the track width puts them under left and right wheels [m]."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Of the scattered bumps."""

    def finest(self) -> float:
        """Five nodes a bump."""
        return min(self.length_m, self.width_m) / 4

    def bare(self, nodes: Array) -> Array:
        """Heights over level ground. Raises ValueError for a row that leaves the field."""
        heights = np.zeros((nodes.size, nodes.size))
        for bump in self.places():
            _raise(heights, nodes, bump, (self.length_m, self.width_m))
        return self.height_m * heights

    def places(self) -> list[Bump]:
        """Where the bumps lie."""
        return self._scattered() if self.layout == "scattered" else self._row()

    def _scattered(self) -> list[Bump]:
        rng = stream(self.seed, "terrain.bumps")
        places = rng.uniform(-self.half_size_m, self.half_size_m, (self.count, 2))
        return [(x, y, h) for (x, y), h in zip(places.tolist(), rng.uniform(0, pi, self.count).tolist(), strict=True)]

    def _row(self) -> list[Bump]:
        heading, found = radians(self.heading_deg), []
        for k in range(self.count):
            along, left = k * self.spacing_m, (k % 2) * self.stagger_m
            x = self.x_m + along * cos(heading) - left * sin(heading)
            y = self.y_m + along * sin(heading) + left * cos(heading)
            if max(abs(x), abs(y)) > self.half_size_m:
                raise ValueError(
                    f"count: bump {k + 1} of the row lies at ({x:.1f}, {y:.1f}) m, outside the field; "
                    f"set count to {k} or less, or make half_size_m larger"
                    if k
                    else f"x_m: the first bump lies at ({x:.1f}, {y:.1f}) m, outside the field; move it"
                )
            found.append((x, y, heading))
        return found


def _raise(heights: Array, nodes: Array, bump: Bump, size: tuple[float, float]) -> None:
    """Lay one bump of height 1 over `heights` (n, n), in the window of nodes around it."""
    x, y, heading = bump
    reach = np.hypot(*size) / 2
    step = (nodes[-1] - nodes[0]) / (nodes.size - 1)
    row, column = (
        slice(max(0, ceil((c - reach - nodes[0]) / step)), ceil((c + reach - nodes[0]) / step)) for c in (y, x)
    )
    dx, dy = nodes[None, column] - x, nodes[row, None] - y
    a = (cos(heading) * dx + sin(heading) * dy) / size[0]
    b = (cos(heading) * dy - sin(heading) * dx) / size[1]
    shape = (np.cos(pi * np.clip(a, -0.5, 0.5)) * np.cos(pi * np.clip(b, -0.5, 0.5))) ** 2
    np.maximum(heights[row, column], shape, out=heights[row, column])
