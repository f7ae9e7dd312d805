"""The ground under the tractor: one file a kind, all of them one height grid."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.terrain.flat import Flat
from agrobot_mj.terrain.grid import Ground, height_and_gradient, surface_at
from agrobot_mj.terrain.slope import Slope

Terrain = Annotated[
    Flat
    | Slope,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = ["Flat", "Ground", "Slope", "Terrain", "height_and_gradient", "surface_at"]
