"""Ground: a height grid with bilinear interpolation, and a grid of ground properties.

`Ground` is a tuple of numbers and arrays for compiled kernels. Nodes are at (x0 + column * spacing, y0 + row *
spacing), heights have shape (rows, columns) [m]. Points outside the height grid have the height of its nearest border
point; `Ground.covers` tests whether a point is on the grid. Friction, cone index and rolling resistance have a separate
grid of square cells and are uniform in each cell. Outside this grid the surface of the terrain or the tyre law defines
these properties.
"""

from fractions import Fraction
from math import ceil, floor, log10, nan
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.kernels import jit, kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.terrain.memory import FORGETS, SoilMemory

MOST_NODES = 4_200_000  # Maximum number of nodes of a height grid: 34 MB, or a square of 200 m with a node every 0.1 m
MOST_STEPS = 1000
"""Maximum number of cells along the longer side of a rectangular plane. The shorter side is rounded to whole cells, by
at most 0.1 %."""


class Surface(NamedTuple):
    """Grid of ground properties, which are uniform in each cell; the south-west corner of the grid is at (x0, y0)."""

    x0: float  # West edge of the grid [m]
    y0: float  # South edge of the grid [m]
    spacing: float  # Side length of a cell [m]
    friction: Array  # Factor on the tyre friction [-], shape (rows, columns)
    cone_index: Array  # Cone index of the soil [Pa], same shape; 0 selects the tyre law
    rolling: Array = np.empty((0, 0))
    """Rolling resistance divided by load [-], in the shape of `friction` or empty. 0 selects the tyre law."""
    elsewhere: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Friction factor [-], cone index [Pa] and rolling resistance [-] outside the property grid."""


NOTHING_SPECIAL = Surface(0.0, 0.0, 1.0, np.empty((0, 0)), np.empty((0, 0)))
"""Property grid without cells: friction, cone index and rolling resistance of the tyre law apply everywhere."""


class Ground(NamedTuple):
    """Height grid and properties of the ground."""

    x0: float  # East coordinate of column 0 [m]
    y0: float  # North coordinate of row 0 [m]
    spacing: float  # Distance between neighbouring nodes in both directions [m]
    heights: Array  # Heights of the nodes [m], shape (rows, columns), at least 2 x 2
    surface: Surface = NOTHING_SPECIAL
    planar: bool = False  # Whether `plane` created the height grid
    memory: SoilMemory = FORGETS  # Ruts in soil with plastic deformation; each plant has a separate copy

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Limits (x_min, x_max, y_min, y_max) of the height grid [m], to the east and north of the origin."""
        rows, columns = self.heights.shape
        return (self.x0, self.x0 + (columns - 1) * self.spacing, self.y0, self.y0 + (rows - 1) * self.spacing)

    def covers(self, x: float, y: float) -> bool:
        """Return whether the point (x, y) [m] is on the height grid."""
        x_min, x_max, y_min, y_max = self.extent
        return x_min <= x <= x_max and y_min <= y <= y_max

    @property
    def steepest(self) -> float:
        """Maximum slope between neighbouring nodes in a row or column [-]."""
        return float(max(np.abs(np.diff(self.heights, axis=axis)).max() for axis in (0, 1)) / self.spacing)

    @property
    def is_plane(self) -> bool:
        """Whether the height grid is known to be a plane: created by `plane`, or one cell with coplanar nodes."""
        h = self.heights
        return self.planar or (h.shape == (2, 2) and abs(h[0, 0] + h[1, 1] - h[0, 1] - h[1, 0]) < 1e-9)


@kernel
def height_and_gradient(ground: Ground, x: float, y: float) -> tuple[float, float, float]:
    """Return the height of the ground [m] and its slopes dh/dx and dh/dy [-] at (x, y) [m]."""
    rows, columns = ground.heights.shape
    if x != x or y != y:  # compiled code would convert NaN to the index -2^63, without a bounds check
        return nan, nan, nan
    a = min(max((x - ground.x0) / ground.spacing, 0.0), columns - 1.0)
    b = min(max((y - ground.y0) / ground.spacing, 0.0), rows - 1.0)
    i, j = min(int(a), columns - 2), min(int(b), rows - 2)
    s, t = a - i, b - j
    h00, h01 = ground.heights[j, i], ground.heights[j, i + 1]
    h10, h11 = ground.heights[j + 1, i], ground.heights[j + 1, i + 1]
    height = (1 - t) * ((1 - s) * h00 + s * h01) + t * ((1 - s) * h10 + s * h11)
    dx = ((1 - t) * (h01 - h00) + t * (h11 - h10)) / ground.spacing
    dy = ((1 - s) * (h10 - h00) + s * (h11 - h01)) / ground.spacing
    return height, dx, dy


@kernel
def surface_at(surface: Surface, x: float, y: float) -> tuple[float, float]:
    """Return the friction factor [-] and cone index [Pa] at (x, y) [m]. A cone index of 0 selects the tyre law."""
    rows, columns = surface.friction.shape
    a, b = (x - surface.x0) / surface.spacing, (y - surface.y0) / surface.spacing
    if not (0.0 <= a < columns and 0.0 <= b < rows):
        return surface.elsewhere[0], surface.elsewhere[1]
    return surface.friction[int(b), int(a)], surface.cone_index[int(b), int(a)]


@kernel
def rolling_at(surface: Surface, x: float, y: float) -> float:
    """Return the rolling resistance divided by load [-] at (x, y) [m]. A result of 0 selects the tyre law."""
    rows, columns = surface.rolling.shape
    a, b = (x - surface.x0) / surface.spacing, (y - surface.y0) / surface.spacing
    if not (0.0 <= a < columns and 0.0 <= b < rows):
        return surface.elsewhere[2]
    return float(surface.rolling[int(b), int(a)])


@jit
def heights(ground: Ground, x: Array, y: Array) -> Array:
    """Return the heights of the ground [m] at the points (x, y) [m], in the shape of `x`."""
    found = np.empty(x.size)
    for k, (a, b) in enumerate(zip(x.ravel(), y.ravel())):  # noqa: B905
        found[k] = height_and_gradient(ground, a, b)[0]
    return found.reshape(x.shape)


def plane(grade_x: float, grade_y: float, half_x: float, half_y: float | None = None) -> Ground:
    """Return a plane through the origin with the slopes `grade_x` to the east and `grade_y` to the north [-].

    The plane extends `half_x` [m] to the east and west, and `half_y` (default: `half_x`) to the north and south. A
    square has one cell. A rectangle has square cells, at most `MOST_STEPS` along its longer side.
    """
    half_y = half_x if half_y is None else half_y
    ratio = Fraction(min(half_x, half_y) / max(half_x, half_y)).limit_denominator(MOST_STEPS)
    columns, rows = (ratio.denominator, ratio.numerator) if half_y <= half_x else (ratio.numerator, ratio.denominator)
    spacing = 2 * half_x / columns if half_y <= half_x else 2 * half_y / rows
    x, y = (spacing * (np.arange(n + 1) - n / 2) for n in (columns, rows))
    heights = grade_x * x[None, :] + grade_y * y[:, None]
    return Ground(float(x[0]), float(y[0]), spacing, np.ascontiguousarray(heights), planar=True)


def rounded_up(value: float) -> float:
    """Return `value` rounded up to two significant digits, for messages."""
    step = 10.0 ** (floor(log10(value)) - 1)
    return ceil(value / step - 1e-9) * step


def rounded_down(value: float) -> float:
    """Return `value` rounded down to two significant digits, for messages."""
    step = 10.0 ** (floor(log10(value)) - 1)
    return floor(value / step + 1e-9) * step
