"""Level ground."""

from typing import Literal

from agrobot_mj.core.spec import Positive
from agrobot_mj.terrain.base import Landscape
from agrobot_mj.terrain.grid import Ground, plane


class Flat(Landscape):
    """Level ground at height zero."""

    kind: Literal["flat"] = "flat"
    half_size_m: Positive = 500.0
    """From the origin to each edge of the field [m]."""

    def relief(self) -> Ground:
        """The height grid."""
        return plane(0.0, 0.0, self.half_size_m)
