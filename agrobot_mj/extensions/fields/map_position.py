"""Position of a field in the map of its elevation model."""

from collections.abc import Mapping
from math import atan2, degrees
from pathlib import Path
from typing import Any

from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.paths.imports.shapes import DEGREES
from agrobot_mj.terrain.geotiff import map_system

ORIGIN, FILE = "terrain.map_origin_m", "terrain.file"
ROTATED_DEG = 0.5  # Angle between grid north and north above which a note states the angle [deg]
NORTH_M = 100.0  # Distance north of the origin from which the direction of grid north is computed [m]


def with_map_origin(field: Field, overrides: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Return overrides in which `terrain.map_origin_m` is the position of the field's origin in the map of the
    elevation model, and a note, or an empty note if the overrides are unchanged.

    The map system is that of the field or, for a field in degrees, of the GeoTIFF.
    """
    given = dict(overrides)
    file = given.get(FILE)
    if not isinstance(file, str) or ORIGIN in given or Path(file).suffix.lower() not in (".tif", ".tiff", ".asc"):
        return given, ""
    name, system = Path(file).name, field.crs if field.crs != DEGREES else ""
    if not system and Path(file).suffix.lower() != ".asc":
        try:
            system = map_system(Path(file))
        except (ValueError, OSError):
            return given, ""  # a message about the file follows when it is read
    if field.plane is None or not system:
        return given, f"the middle of {name} is at the origin of the field; set {ORIGIN} for the true position"
    (east, east_above), (north, north_above) = _map_coordinates(system, field.plane, (0.0, NORTH_M))
    given[ORIGIN] = [round(east, 3), round(north, 3)]
    note = f"the origin of the field is at ({east:.1f}, {north:.1f}) m in {system}, the system of {name}"
    if abs(turned := degrees(atan2(east_above - east, north_above - north))) > ROTATED_DEG:
        note += f"; its grid is turned by {turned:.1f} deg, which is ignored"
    return given, note


def _map_coordinates(system: str, plane: Origin, norths: tuple[float, ...]) -> tuple[list[float], list[float]]:
    """Return eastings and northings [m] in a map of the points that are `norths` [m] north of the origin of a local
    plane."""
    from pyproj import Transformer

    latitudes, longitudes = zip(*(to_geodetic(plane, 0.0, north) for north in norths), strict=True)
    transformer = Transformer.from_crs(DEGREES, system, always_xy=True)
    eastings, northings = transformer.transform(list(longitudes), list(latitudes))
    return eastings, northings
