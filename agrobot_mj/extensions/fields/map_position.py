"""Elevation model of a field: heights in its files, and position of the field in the map of the model."""

from collections.abc import Mapping
from math import atan2, degrees
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geodesy import Origin, to_geodetic, to_local
from agrobot_mj.core.resources import stamp_of
from agrobot_mj.extensions.fields.drive import planning_scenario
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.slope import farthest_point
from agrobot_mj.paths.imports.shapes import DEGREES
from agrobot_mj.terrain import Heightmap
from agrobot_mj.terrain.elevation import WAVE_M, interpolate, read_elevation
from agrobot_mj.terrain.files import MOST_BYTES
from agrobot_mj.terrain.geotiff import map_system
from agrobot_mj.terrain.grid import Ground

KIND, ORIGIN, FILE = "terrain.kind", "terrain.map_origin_m", "terrain.file"
ROTATED_DEG = 0.5  # Angle between grid north and north above which a note states the angle [deg]
FAR_FROM_POINTS_M = WAVE_M / 2
"""Distance from the measured heights above which a note is given [m]: half of the shortest relief in Elevation.txt."""
NORTH_M = 100.0  # Distance north of the origin from which the direction of grid north is computed [m]


def with_terrain(field: Field, overrides: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Return overrides with the elevation model of a field and with `terrain.map_origin_m`, the position of the field's
    origin in the map of this model, and a note, or an empty note.

    Without `terrain.kind`, the model is the `Elevation.txt` in the folder of the field, unless this file is unusable or
    the plant supports only level ground.
    """
    given, level = dict(overrides), overrides.get("plant.kind") == "bicycle"
    if field.elevation is not None and not level and not given.keys() & {"terrain", KIND, FILE}:
        return _with_recorded_heights(field, given, field.elevation.absolute())
    file = given.get(FILE)
    if not isinstance(file, str) or ORIGIN in given:
        return given, ""
    suffix = Path(file).suffix.lower()
    if suffix == ".txt":
        return _in_local_plane(field, given, file)
    if suffix not in (".tif", ".tiff", ".asc"):
        return given, ""
    name, system = Path(file).name, field.crs if field.crs != DEGREES else ""
    if not system and suffix != ".asc":
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


def _with_recorded_heights(field: Field, given: dict[str, Any], file: Path) -> tuple[dict[str, Any], str]:
    """Return the overrides `given` with the heights in an Elevation.txt, and a note. Unusable heights are omitted."""
    found, note = _in_local_plane(field, {**given, KIND: "heightmap", FILE: str(file)}, str(file))
    try:
        ground = Heightmap(file=str(file), map_origin_m=tuple(found.get(ORIGIN, (0.0, 0.0)))).ground()
    except ValueError as error:
        return given, f"the ground is level, because of {str(error).removeprefix('file: ')}"
    if not _covers(ground, field):
        return given, f"the ground is level, because {file.name} does not cover the field"
    return found, note


def _covers(ground: Ground, field: Field) -> bool:
    west, south, east, north = field.boundary.bounds
    return ground.covers(west, south) and ground.covers(east, north)


def ground_of(field: Field, given: Mapping[str, Any]) -> tuple[Ground | None, tuple[str, ...]]:
    """Return the ground of a field, or None if its heights are unknown, and notes about the heights.

    The ground is the terrain in `given`, a result of `with_terrain`, or else the ground through the boundary. Raise
    `ScenarioError` for an invalid terrain.
    """
    if any(key.partition(".")[0] == "terrain" for key in given):
        terrain = planning_scenario(field.name, {}, given).terrain
        try:
            ground = terrain.ground()
        except ValueError as error:
            raise ScenarioError(f"terrain.{error}") from None
        partial = () if _covers(ground, field) else ("the terrain does not cover the whole field",)
        return ground, (*terrain.notes, *partial)
    if field.heights is None:
        return None, ()
    return interpolate(field.heights[:, :2], field.heights[:, 2])[0], ("the slope is computed from the boundary",)


def _in_local_plane(field: Field, given: dict[str, Any], file: str) -> tuple[dict[str, Any], str]:
    """Return the overrides `given` with the position of the field's origin relative to the start fix in an
    Elevation.txt, and a note about this position and about heights far from the measured points."""
    try:
        found = read_elevation(stamp_of(file, (), MOST_BYTES))
    except ValueError:
        return given, ""  # a message about the file follows when it is read
    place = field.shift if field.plane is None else to_local(found.origin, *field.plane)
    notes, (away, x, y) = list[str](), farthest_point(field.boundary, found.points - place)
    if field.plane is None and field.elevation is None:
        notes.append(f"the coordinates of the field are assumed to be relative to the start fix in {Path(file).name}")
    if away > FAR_FROM_POINTS_M:
        far = f"parts of the field are up to {away:.0f} m from the nearest measured height, at ({x:z.0f}, {y:z.0f}) m"
        notes.append(far)
    return {**given, ORIGIN: [round(axis, 3) for axis in place]}, "; ".join(notes)


def _map_coordinates(system: str, plane: Origin, norths: tuple[float, ...]) -> tuple[list[float], list[float]]:
    """Return eastings and northings [m] in a map of the points that are `norths` [m] north of the origin of a local
    plane."""
    from pyproj import Transformer

    latitudes, longitudes = zip(*(to_geodetic(plane, 0.0, north) for north in norths), strict=True)
    transformer = Transformer.from_crs(DEGREES, system, always_xy=True)
    eastings, northings = transformer.transform(list(longitudes), list(latitudes))
    return eastings, northings
