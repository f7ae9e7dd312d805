"""Level ground."""

from typing import Literal

from agrobot_mj.terrain.base import Landscape
from agrobot_mj.terrain.extent import Sized
from agrobot_mj.terrain.grid import Ground, plane


class Flat(Sized, Landscape):
    """Level ground at height zero."""

    kind: Literal["flat"] = "flat"

    def relief(self) -> Ground:
        """The height grid."""
        return plane(0.0, 0.0, *self.half_sizes)
