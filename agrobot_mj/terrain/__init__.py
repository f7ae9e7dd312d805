"""Terrain kinds, with one module per kind. A terrain defines the height grid and the properties of the ground."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.terrain.bumps import Bumps
from agrobot_mj.terrain.grid import Ground, height_and_gradient, surface_at
from agrobot_mj.terrain.heightmap import Heightmap
from agrobot_mj.terrain.plane import Flat, Slope
from agrobot_mj.terrain.ridges import Ridges
from agrobot_mj.terrain.rough import Rough

Terrain = Annotated[
    Flat
    | Slope
    | Bumps
    | Ridges
    | Rough
    | Heightmap,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = [
    "Bumps",
    "Flat",
    "Ground",
    "Heightmap",
    "Ridges",
    "Rough",
    "Slope",
    "Terrain",
    "height_and_gradient",
    "surface_at",
]
