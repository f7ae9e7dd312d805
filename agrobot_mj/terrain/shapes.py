"""Shapes of ground patches: rectangle, circle, polygon and grey image."""

from math import cos, radians, sin
from typing import Annotated, Literal, Self, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from agrobot_mj.core.geometry import check_polygon
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import HUGE, ConeIndex, Positive, Scale, Spec, cone_index_in_range, fill
from agrobot_mj.terrain.files import read_picture
from agrobot_mj.terrain.variation import NAMED, SurfaceName

Bounds = tuple[float, float, float, float]  # Bounding box (x_min, x_max, y_min, y_max) [m]
Coordinate = Annotated[float, Field(ge=-HUGE, le=HUGE)]
Mask: TypeAlias = "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]"


class Special(Spec):
    """Base class of ground patches with separate properties; subclasses override `bounds` and `covers`."""

    kind: str
    surface: SurfaceName | None = None
    """Named surface of the patch, which sets default friction, cone index and rolling resistance. Default: none."""
    friction: Scale = 1.0
    """Factor on the tyre friction [-]. Assumed value, relative to dry ground: 0.6 for wet grass, 0.3 for mud."""
    cone_index_kpa: ConeIndex | None = None
    """Cone index of the soil [kPa]. Default: value of `surface`, else of `terrain.surface`, else of the tyre law."""
    rolling_resistance: Annotated[float, Field(ge=0, le=1)] | None = None
    """Rolling resistance on firm ground divided by load [-]. Default: from `surface`, `terrain.surface` or the tyre
    law."""
    cell_m: Annotated[float, Field(ge=0.01, le=HUGE)] = 0.25
    """Side length of the grid cells that represent the shape [m]. The smallest `cell_m` of all patches applies to all
    patches."""

    @model_validator(mode="after")
    def _fill_from_surface(self) -> Self:
        if self.surface is not None:
            for key, value in NAMED[self.surface]._asdict().items():
                fill(self, [key], value)
        return self

    def bounds(self) -> Bounds:
        """Return the bounding box (x_min, x_max, y_min, y_max) of the patch [m]."""
        raise NotImplementedError

    def covers(self, x: Array, y: Array) -> Mask:
        """Return whether the grid points are on the patch, as a mask of shape (m, n).

        `x` (1, n) and `y` (m, 1) are the coordinates of the points in increasing order [m].
        """
        raise NotImplementedError

    def properties(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return the friction factor [-] and cone index [Pa] at the points (x, y) [m], in the shape of `x`.

        A cone index of 0 means that the cone index of the terrain outside the patches applies.
        """
        return np.full(x.shape, self.friction), np.full(x.shape, 1e3 * (self.cone_index_kpa or 0.0))


class RectanglePatch(Special):
    """Rectangular ground patch defined by centre, size and heading."""

    kind: Literal["rectangle"] = "rectangle"
    x_m: float = 0.0
    """East coordinate of the centre of the rectangle [m]."""
    y_m: float = 0.0
    """North coordinate of the centre of the rectangle [m]."""
    length_m: Positive = 10.0
    """Length of the rectangle along its heading [m]."""
    width_m: Positive = 10.0
    """Width of the rectangle across its heading [m]."""
    heading_deg: float = 0.0
    """Direction of the side `length_m` [deg], counter-clockwise from east."""

    def bounds(self) -> Bounds:
        """Return the bounding box (x_min, x_max, y_min, y_max) of the rectangle [m]."""
        c, s = abs(cos(radians(self.heading_deg))), abs(sin(radians(self.heading_deg)))
        a = (c * self.length_m + s * self.width_m) / 2
        b = (s * self.length_m + c * self.width_m) / 2
        return self.x_m - a, self.x_m + a, self.y_m - b, self.y_m + b

    def covers(self, x: Array, y: Array) -> Mask:
        """Return whether the points `x` (1, n) and `y` (m, 1) [m] are on the rectangle, as a mask of shape (m, n)."""
        c, s = cos(radians(self.heading_deg)), sin(radians(self.heading_deg))
        along, across = c * (x - self.x_m) + s * (y - self.y_m), c * (y - self.y_m) - s * (x - self.x_m)
        return (2 * np.abs(along) <= self.length_m) & (2 * np.abs(across) <= self.width_m)


class CirclePatch(Special):
    """Circular ground patch defined by centre and radius."""

    kind: Literal["circle"] = "circle"
    x_m: float = 0.0
    """East coordinate of the centre of the circle [m]."""
    y_m: float = 0.0
    """North coordinate of the centre of the circle [m]."""
    radius_m: Positive = 5.0
    """Radius of the circle [m]."""

    def bounds(self) -> Bounds:
        """Return the bounding box (x_min, x_max, y_min, y_max) of the circle [m]."""
        r = self.radius_m
        return self.x_m - r, self.x_m + r, self.y_m - r, self.y_m + r

    def covers(self, x: Array, y: Array) -> Mask:
        """Return whether the grid points `x` (1, n) and `y` (m, 1) [m] are on the circle, as a mask of shape (m, n)."""
        return np.hypot(x - self.x_m, y - self.y_m) <= self.radius_m


class PolygonPatch(Special):
    """Ground patch with the shape of a polygon. If edges cross, points enclosed an even number of times are outside."""

    kind: Literal["polygon"] = "polygon"
    points: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=3, max_length=1000)] = (
        *((-5.0, -5.0), (5.0, -5.0)),
        (0.0, 5.0),
    )
    """Corners [east, north], clockwise or counter-clockwise [m]; the last corner is connected to the first corner."""

    @model_validator(mode="after")
    def _check_corners(self) -> "PolygonPatch":
        check_polygon(self.points)
        return self

    def bounds(self) -> Bounds:
        """Return the bounding box (x_min, x_max, y_min, y_max) of the polygon [m]."""
        x, y = zip(*self.points, strict=True)
        return min(x), max(x), min(y), max(y)

    def covers(self, x: Array, y: Array) -> Mask:
        """Return whether the grid points are in the polygon, where a ray to the east crosses an odd number of edges."""
        x, y = x[0], y[:, 0]
        crossed = np.zeros((len(y), len(x) + 1), dtype=np.bool_)
        for (x0, y0), (x1, y1) in zip(self.points, (*self.points[1:], self.points[0]), strict=True):
            if y0 != y1:
                rows = np.flatnonzero((y0 <= y) != (y1 <= y))
                crossed[rows, np.searchsorted(x, x0 + (y[rows] - y0) / (y1 - y0) * (x1 - x0))] ^= True
        # a crossing east of the first k columns inverts these k columns
        odd: Mask = np.logical_xor.accumulate(crossed[:, ::-1], axis=1)[:, ::-1]
        return odd[:, 1:]


class PicturePatch(Special):
    """Ground patch defined by a grey image, north at the top; black pixels have `friction` and `cone_index_kpa`."""

    kind: Literal["image"] = "image"
    file: Annotated[str, Field(min_length=1)]
    """Grey .png file of 8 or 16 bits: path relative to the scenario's folder, or name of a shipped file."""
    x_m: float = 0.0
    """East coordinate of the centre of the image [m]."""
    y_m: float = 0.0
    """North coordinate of the centre of the image [m]."""
    width_m: Positive = 100.0
    """Width of the image on the ground, west to east [m]; the height follows from the proportions of the image."""
    friction_white: Scale | None = None
    """Factor on the friction [-] at white pixels, interpolated linearly for grey pixels. Default: `friction`."""
    cone_index_white_kpa: Positive | None = None
    """Cone index at white pixels, interpolated linearly for grey pixels [kPa]. Default: `cone_index_kpa`."""

    @model_validator(mode="after")
    def _check_white_value(self) -> "PicturePatch":
        if self.cone_index_kpa is None and self.cone_index_white_kpa is not None:
            raise ValueError("cone_index_white_kpa: needs cone_index_kpa, the value where the image is black")
        if self.cone_index_white_kpa is not None:
            try:
                cone_index_in_range(self.cone_index_white_kpa)
            except ValueError as error:
                raise ValueError(f"cone_index_white_kpa: {error}") from None
        return self

    def bounds(self) -> Bounds:
        """Return the bounding box (x_min, x_max, y_min, y_max) of the image [m].

        Raises ValueError if the image file cannot be read.
        """
        rows, columns = read_picture(self.file).shape
        a, b = self.width_m / 2, self.width_m / 2 * rows / columns
        return self.x_m - a, self.x_m + a, self.y_m - b, self.y_m + b

    def covers(self, x: Array, y: Array) -> Mask:
        """Return whether the grid points `x` (1, n) and `y` (m, 1) [m] are on the image, as a mask of shape (m, n)."""
        x_min, x_max, y_min, y_max = self.bounds()
        return (x_min <= x) & (x < x_max) & (y_min <= y) & (y < y_max)

    def properties(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return the friction factor [-] and cone index [Pa] of the image pixel at each point (x, y) [m]."""
        brightness = read_picture(self.file)
        x_min, _, y_min, _ = self.bounds()
        rows, columns = brightness.shape
        pixel = self.width_m / columns
        row = np.clip(((y - y_min) / pixel).astype(int), 0, rows - 1)
        column = np.clip(((x - x_min) / pixel).astype(int), 0, columns - 1)
        grey, dark = brightness[row, column], 1e3 * (self.cone_index_kpa or 0.0)
        white = dark if self.cone_index_white_kpa is None else 1e3 * self.cone_index_white_kpa
        bright = self.friction if self.friction_white is None else self.friction_white
        return self.friction + grey * (bright - self.friction), dark + grey * (white - dark)
