"""What reliefs made from a formula share: a square field, its nodes, and a level run-in around the origin."""

from math import ceil, radians, sqrt, tan
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import HUGE, NonNegative, Positive
from agrobot_mj.terrain.base import STEEPEST_DEG, Tilted
from agrobot_mj.terrain.grid import MOST_NODES, Ground, rounded_down, rounded_up

Node = Annotated[float, Field(ge=0.01, le=HUGE)]


class Generated(Tilted):
    """A relief from a formula; a kind overrides `bare`, and `finest` if it has details to resolve."""

    VERTICAL: ClassVar[str] = "grade_deg"
    """The key that says how high the relief is."""

    half_size_m: Positive = 75.0
    """From the origin to each edge of the field [m]."""
    node_m: Node = 0.1
    """Largest distance between nodes of the grid [m]. Estimate: less than the length of a tyre's contact patch."""
    run_in_m: NonNegative = 0.0
    """The relief is missing as far from the origin, and has its full height at twice that distance [m]."""

    def bare(self, nodes: Array) -> Array:
        """Heights without plane and run-in, shape (n, n), at nodes (n,) along both axes [m]."""
        raise NotImplementedError

    def finest(self) -> float:
        """Largest distance between nodes that resolves the relief [m]."""
        return HUGE

    def relief(self) -> Ground:
        """The height grid."""
        half, cells = self.half_size_m, self._cells()
        nodes = np.linspace(-half, half, cells + 1)
        heights = self.bare(nodes)
        if self.run_in_m > 0:
            heights = heights * _fade(np.hypot(nodes[None, :], nodes[:, None]) / self.run_in_m - 1.0)
        ground = Ground(-half, -half, 2 * half / cells, np.ascontiguousarray(heights))
        if ground.steepest > tan(radians(STEEPEST_DEG)):
            raise ValueError(f"{self.VERTICAL}: makes flanks steeper than {STEEPEST_DEG:g} deg; make it smaller")
        return self.tilted(ground)

    def _cells(self) -> int:
        """Along a side of the field. Raises ValueError for a grid that is too coarse or has too many nodes."""
        if self.node_m > self.finest():
            raise ValueError(
                f"node_m: {self.node_m:g} m is too coarse for this relief; set at most {self.finest():.3g}"
            )
        cells = max(1, ceil(2 * self.half_size_m / self.node_m - 1e-9))
        if (cells + 1) ** 2 > MOST_NODES:
            most = int(sqrt(MOST_NODES)) - 1
            node, half = rounded_up(2 * self.half_size_m / most), rounded_down(self.node_m * most / 2)
            raise ValueError(
                f"node_m: {cells + 1} x {cells + 1} nodes are more than {MOST_NODES}; "
                f"set {f'node_m to {node:g} or ' if node <= self.finest() else ''}half_size_m to {half:g}"
            )
        return cells


def _fade(share: Array) -> Array:
    """From 0 at shares below 0 to 1 above 1, with a smooth slope."""
    s = np.clip(share, 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)
