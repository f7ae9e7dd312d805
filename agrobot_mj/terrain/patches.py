"""Patches of ground with a friction or a soil of their own: shapes, rasterised into one grid of uniform cells."""

from math import cos, hypot, radians, sin
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from agrobot_mj.signals import Array
from agrobot_mj.spec import Positive, Spec
from agrobot_mj.terrain.grid import Surface

MOST_CELLS = 4_000_000
"""In the grid of properties: 64 MB."""

Bounds = tuple[float, float, float, float]
"""(x_min, x_max, y_min, y_max) [m]."""


class Special(Spec):
    """Ground with properties of its own; a shape overrides `bounds` and `covers`."""

    kind: str
    friction: Positive = 1.0
    """Scale of the tyres' friction [-]. Wet grass over dry ground about 0.6, estimate."""
    cone_index_kpa: Positive | None = None
    """Of the soil; the tyre's own when left out [kPa]."""
    cell_m: Positive = 0.25
    """Size of the cells that stand for the shape; the finest of all patches counts [m]."""

    def bounds(self) -> Bounds:
        """The box around the shape."""
        raise NotImplementedError

    def covers(self, x: Array, y: Array) -> "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]":
        """Whether points lie on the patch, shape as `x` and `y` [m]."""
        raise NotImplementedError


class Rectangle(Special):
    """A rectangle about its centre."""

    kind: Literal["rectangle"] = "rectangle"
    x_m: float = 0.0
    """Centre, east [m]."""
    y_m: float = 0.0
    """Centre, north [m]."""
    length_m: Positive = 10.0
    """Along its heading [m]."""
    width_m: Positive = 10.0
    """Across [m]."""
    heading_deg: float = 0.0
    """Of its length, from east, counter-clockwise [deg]."""

    def bounds(self) -> Bounds:
        """The box around the shape."""
        c, s = abs(cos(radians(self.heading_deg))), abs(sin(radians(self.heading_deg)))
        a = (c * self.length_m + s * self.width_m) / 2
        b = (s * self.length_m + c * self.width_m) / 2
        return self.x_m - a, self.x_m + a, self.y_m - b, self.y_m + b

    def covers(self, x: Array, y: Array) -> "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]":
        """Whether points lie on the patch."""
        c, s = cos(radians(self.heading_deg)), sin(radians(self.heading_deg))
        along, across = c * (x - self.x_m) + s * (y - self.y_m), c * (y - self.y_m) - s * (x - self.x_m)
        return (2 * np.abs(along) <= self.length_m) & (2 * np.abs(across) <= self.width_m)


class Circle(Special):
    """A disc about its centre."""

    kind: Literal["circle"] = "circle"
    x_m: float = 0.0
    """Centre, east [m]."""
    y_m: float = 0.0
    """Centre, north [m]."""
    radius_m: Positive = 5.0
    """[m]."""

    def bounds(self) -> Bounds:
        """The box around the shape."""
        r = self.radius_m
        return self.x_m - r, self.x_m + r, self.y_m - r, self.y_m + r

    def covers(self, x: Array, y: Array) -> "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]":
        """Whether points lie on the patch."""
        return np.hypot(x - self.x_m, y - self.y_m) <= self.radius_m


Patch = Annotated[Rectangle | Circle, Field(discriminator="kind")]


def surface(patches: tuple[Special, ...], extent: Bounds) -> Surface:
    """The grid of properties of `patches` on ground of this extent. Raises ValueError, naming the key."""
    boxes = [_inside(k, patch.bounds(), extent) for k, patch in enumerate(patches)]
    low_x, low_y = min(box[0] for box in boxes), min(box[2] for box in boxes)
    cell = min(patch.cell_m for patch in patches)
    columns = int(np.ceil((max(box[1] for box in boxes) - low_x) / cell))
    rows = int(np.ceil((max(box[3] for box in boxes) - low_y) / cell))
    if rows * columns > MOST_CELLS:
        raise ValueError(
            f"patch: {rows} x {columns} cells are more than {MOST_CELLS}; make cell_m larger, e.g. "
            f"{cell * hypot(1, 1) * (rows * columns / MOST_CELLS) ** 0.5:.2g}"
        )
    x, y = np.meshgrid(low_x + cell * (np.arange(columns) + 0.5), low_y + cell * (np.arange(rows) + 0.5))
    friction, cone_index = np.ones(x.shape), np.zeros(x.shape)
    for patch in patches:
        covered = patch.covers(x, y)
        friction[covered] = patch.friction
        cone_index[covered] = 1e3 * (patch.cone_index_kpa or 0.0)
    return Surface(low_x, low_y, cell, friction, cone_index)


def _inside(k: int, box: Bounds, extent: Bounds) -> Bounds:
    x_min, x_max = max(box[0], extent[0]), min(box[1], extent[1])
    y_min, y_max = max(box[2], extent[2]), min(box[3], extent[3])
    if x_min >= x_max or y_min >= y_max:
        raise ValueError(
            f"patch[{k}]: lies outside the field ({extent[0]:g} to {extent[1]:g} m east, {extent[2]:g} to "
            f"{extent[3]:g} m north); move it or make the terrain larger"
        )
    return x_min, x_max, y_min, y_max
