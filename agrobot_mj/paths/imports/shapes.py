"""Shapes of a position file: polylines, rings and sequences of points, in file coordinates or in a local plane."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from agrobot_mj.core.geodesy import Origin
from agrobot_mj.core.signals import Array

LARGEST = 1e8  # Maximum absolute coordinate [m or deg], larger than in any map grid
DEGREES = "EPSG:4326"  # Coordinate system of latitudes and longitudes on WGS84


@dataclass(frozen=True, eq=False)
class Polyline:
    """Polyline, ring or sequence of points, with its role and properties."""

    points: Array  # Points, shape (n, 2): east then north [m], or longitude then latitude [deg]
    ring: bool = False  # Whether the shape is the outline of an area
    role: str = ""  # Role of the shape in its file: boundary, hole, obstacle, headland, track, tram or other
    name: str = ""
    columns: Mapping[str, Array] = field(default_factory=dict)
    """Additional arrays of shape (n,) by column name, with one value per point: speed [m/s], whether the implement
    works (0 or 1), driving direction (1 forward, -1 reverse), height [m], and row of the table."""
    properties: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ShapeFile:
    """Shapes of one file in the coordinates of the file."""

    shapes: tuple[Polyline, ...]  # Shapes in the order of the file; a hole follows the ring around it
    crs: str = ""  # Coordinate system, for example EPSG:4326 for degrees, or "" for metres of an unknown system
    origin: Origin | None = None
    """Geographic position of the origin of local coordinates in metres, or None if unknown."""
    name: str = ""
    notes: tuple[str, ...] = ()  # Sentences about omitted or repaired shapes

    def __post_init__(self) -> None:
        for shape in self.shapes:
            if len(wrong := np.flatnonzero(~(np.abs(shape.points) <= LARGEST).all(axis=1))):
                east, north = shape.points[wrong[0]].tolist()
                raise ValueError(f"position {wrong[0] + 1}, ({east:g}, {north:g}), is out of range; correct the point")


@dataclass(frozen=True, eq=False)
class LocalShapes:
    """Shapes in a local plane, x east and y north [m]."""

    shapes: tuple[Polyline, ...]
    origin: Origin | None = None  # Geographic position of x = y = 0, or None if unknown
    crs: str = ""
    shift: tuple[float, float] = (0.0, 0.0)  # East and north offsets subtracted from the coordinates of the file [m]
    name: str = ""
    notes: tuple[str, ...] = ()  # Sentences about omitted, repaired or shifted shapes
