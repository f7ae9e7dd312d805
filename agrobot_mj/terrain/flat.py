"""Level ground, and the base that every kind of terrain shares."""

from typing import Literal

from agrobot_mj.spec import Positive, Spec
from agrobot_mj.terrain.grid import Ground, plane


class Flat(Spec):
    """Level ground at height zero."""

    kind: Literal["flat"] = "flat"
    half_size_m: Positive = 500.0
    """From the origin to each edge of the field [m]."""

    def ground(self) -> Ground:
        """The height grid."""
        return plane(0.0, 0.0, self.half_size_m)
