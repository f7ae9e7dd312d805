"""Fields, and legs of plans, in a local plane with x east and y north of an origin [m]."""

from dataclasses import dataclass, field
from pathlib import Path

from shapely import Polygon

from agrobot_mj.core.geodesy import Origin
from agrobot_mj.core.signals import Array


@dataclass(frozen=True)
class Field:
    """Field boundary with obstacles and geographic position."""

    name: str  # Name of the field, given by its file
    boundary: Polygon  # Boundary of the field [m]. The holes of this polygon are not part of the field.
    obstacles: tuple[Polygon, ...] = ()
    """Obstacles inside the boundary [m], which tractor and implement must not touch."""
    plane: Origin | None = None
    """Geographic position of the origin of the local plane, or None if the coordinate system of the file is unknown."""
    notes: tuple[str, ...] = ()  # Sentences about repairs of the geometry in the file
    headland: Polygon | None = None
    """Polygon bounded by the headland line in the file [m], or None if the file has no headland line."""
    crs: str = ""  # Coordinate system of the file, for example EPSG:32631. Empty for metres in an unknown system.
    shift: tuple[float, float] = (0.0, 0.0)
    """East and north offsets subtracted from the coordinates in the file [m], or 0 for coordinates in degrees."""
    elevation: Path | None = None  # File of recorded heights in the folder of the field
    heights: Array | None = field(default=None, compare=False)
    """Points of the boundary with different heights, shape (n, 3) [m], or None if the file has no heights."""


@dataclass(frozen=True, eq=False)
class Leg:
    """Part of a plan with constant travel direction and constant working state of the implement."""

    points: Array  # Points in driving order [m], shape (n, 2)
    speed_m_s: float | None = None  # Speed of the leg [m/s], or None if the plan gives no speed
    working: bool = True  # Whether the implement works on this leg
    reverse: bool = False  # Whether the tractor drives in reverse
