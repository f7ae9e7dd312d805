"""Terrains computed from a formula: field size, nodes of the height grid, and a level area around the origin.

The node spacing is equal in both directions and divides the longer side of the field evenly. The shorter side is
extended to a multiple of the spacing.
"""

from math import radians, sqrt, tan
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import HUGE, NonNegative, Positive
from agrobot_mj.terrain.base import STEEPEST_DEG, Sized, Tilted, cells_of
from agrobot_mj.terrain.grid import MOST_NODES, Ground, rounded_down, rounded_up

Node = Annotated[float, Field(ge=0.01, le=HUGE)]


class Generated(Sized, Tilted):
    """Base class of terrains whose heights are computed from a formula.

    Subclasses override `bare`, and also `finest` if their details need a fine grid.
    """

    VERTICAL: ClassVar[str] = "grade_deg"
    """Key that scales the heights of the terrain. Messages about steep slopes begin with this key."""

    half_size_m: Positive | None = 75.0
    node_m: Node = 0.1
    """Maximum distance between neighbouring nodes [m]. Assumed value (range 0.05-0.25): shorter than a contact
    patch."""
    run_in_m: NonNegative = 0.0
    """Radius of a level area around the origin [m], with a transition up to twice this radius."""

    def bare(self, x: Array, y: Array) -> Array:
        """Return the heights [m] at the coordinates `x` (columns,) and `y` (rows,) [m], shape (rows, columns).

        The heights exclude the tilted plane and the level area around the origin.
        """
        raise NotImplementedError

    def finest(self) -> float:
        """Return the maximum node spacing [m] with which the height grid resolves the details of the terrain."""
        return HUGE

    def relief(self) -> Ground:
        """Return the height grid with the tilted plane. Raises a ValueError that names an invalid key."""
        columns, rows = self._cells()
        half_x, half_y = self.half_sizes
        spacing = 2 * half_x / columns if half_x >= half_y else 2 * half_y / rows
        x, y = _nodes(half_x, columns, spacing), _nodes(half_y, rows, spacing)
        heights: Array = self.bare(x, y)
        if self.run_in_m > 0:
            share = np.clip(np.hypot(x[None, :], y[:, None]) / self.run_in_m - 1.0, 0.0, 1.0)
            heights = heights * (share * share * (3.0 - 2.0 * share))  # a smooth transition from 0 to 1
        ground = Ground(float(x[0]), float(y[0]), spacing, np.ascontiguousarray(heights))
        if ground.steepest > tan(radians(STEEPEST_DEG)):
            raise ValueError(f"{self.VERTICAL}: the slopes are steeper than {STEEPEST_DEG:g} deg; reduce the value")
        return self.tilt(ground)

    def _cells(self) -> tuple[int, int]:
        """Return the numbers of cells to the east and north. Raises ValueError for too large or too many cells."""
        if self.node_m > self.finest():
            raise ValueError(
                f"node_m: {self.node_m:g} m is too coarse for this relief; set a value of at most {self.finest():.3g}"
            )
        columns, rows = cells_of(self.half_sizes, self.node_m)
        if (columns + 1) * (rows + 1) > MOST_NODES:
            raise ValueError(
                f"node_m: {columns + 1} x {rows + 1} nodes are more than {MOST_NODES}; set {self._fitting()}"
            )
        return columns, rows

    def _fitting(self) -> str:
        east, north = (2 * half for half in self.half_sizes)
        # (east u + 2) (north u + 2) = MOST_NODES for u nodes per metre: 2 more than cells, whose number is rounded up
        linear, square = east + north, east * north
        per_metre = (sqrt(linear**2 + square * (MOST_NODES - 4)) - linear) / square
        node, share, fits = rounded_up(1 / per_metre), per_metre * self.node_m, []
        if node <= self.finest():
            fits.append(f"node_m to {node:g}")
        if self.size_m is None:
            fits.append(f"half_size_m to {rounded_down(share * east / 2):g}")
        else:
            fits.append(f"size_m to [{rounded_down(share * east):g}, {rounded_down(share * north):g}]")
        return " or ".join(fits)


def _nodes(half: float, cells: int, spacing: float) -> Array:
    """Return the node coordinates along one axis [m], symmetric about the origin, shape (cells + 1,)."""
    half = half if cells * spacing <= 2 * half * (1 + 1e-12) else cells * spacing / 2
    return np.linspace(-half, half, cells + 1)
