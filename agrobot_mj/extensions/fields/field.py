"""Field and legs of a plan in a local plane [m]: x east and y north of the origin."""

from dataclasses import dataclass

from shapely import Polygon

from agrobot_mj.core.geodesy import Origin
from agrobot_mj.core.signals import Array


@dataclass(frozen=True)
class Field:
    """Area to be worked, with its obstacles."""

    name: str
    """Name of the field, from its file."""
    boundary: Polygon
    """Boundary of the field [m]; holes of the polygon are not worked."""
    obstacles: tuple[Polygon, ...] = ()
    """Obstacles inside the boundary, which neither the tractor nor the implement may touch [m]."""
    plane: Origin | None = None
    """Geographic position of x = y = 0; None if the coordinate system of the file is unknown."""
    notes: tuple[str, ...] = ()
    """Sentences about repairs of the file."""
    headland: Polygon | None = None
    """Area inside the headland line of the file [m]; None if the file has no headland line."""
    crs: str = ""
    """Coordinate system of the file, for example EPSG:32631; empty for metres of an unknown system."""
    shift: tuple[float, float] = (0.0, 0.0)
    """East and north coordinate of the origin, subtracted from the file's metres [m]; 0 for degrees."""


@dataclass(frozen=True, eq=False)
class Leg:
    """Part of a plan driven in one direction with one state of the implement."""

    points: Array
    """Points of the polyline in driving order, shape (n, 2) [m]."""
    speed_m_s: float | None = None
    """Speed of the leg [m/s]; None if the plan gives no speed."""
    working: bool = True
    """Whether the implement works."""
    reverse: bool = False
    """Whether the tractor drives in reverse."""
