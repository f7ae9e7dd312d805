"""Conversion of file coordinates to a local plane in metres, x east and y north.

Latitudes and longitudes are projected to the plane of `core.geodesy`, with the middle of the points as its origin.
Coordinates of a named system, such as EPSG:25832, are converted to degrees first (pyproj), so that all files of a field
share one plane. Coordinates in metres of an unknown system are unchanged, or shifted to the middle of the points if
they are far from their origin.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from agrobot_mj.core.errors import import_extra
from agrobot_mj.core.geodesy import Origin, local_points
from agrobot_mj.core.signals import Array
from agrobot_mj.paths.imports.shapes import DEGREES, LocalShapes, Polyline, ShapeFile

FAR_M = 2000.0
"""Distance from the origin above which coordinates belong to a map grid [m]. Assumed value, larger than a field."""
OUTSIDE_DEG = 10.0
"""Maximum difference in latitude or longitude from the area of use of a coordinate system [deg]. Assumed value;
coordinates in metres near their origin are about 40 deg outside the area of a grid in Europe."""
LARGEST_M, SMALLEST_M = 100e3, 1.0
"""Maximum and minimum extent of the points in a file [m]. Coordinates below the minimum are probably degrees."""


def local_shapes(file: ShapeFile, crs: str = "", plane: LocalShapes | None = None) -> LocalShapes:
    """Return the shapes of a file in metres of a local plane.

    `crs` replaces the coordinate system of the file. `plane` is the result for another file of the same field, whose
    local plane is reused. Raise ValueError if the coordinates do not match the coordinate system.
    """
    if not any(len(shape.points) for shape in file.shapes):
        raise ValueError("the file contains no positions; export the file again")
    crs = crs or file.crs
    if crs:
        return _from_degrees(*_geographic(file, crs), crs, plane)
    if plane is not None and plane.origin is not None and file.origin is not None:
        east, north = local_points(plane.origin, np.array([file.origin.latitude]), np.array([file.origin.longitude]))[0]
        return _shift_shapes(file, (-float(east), -float(north)), plane.origin)
    shift = plane.shift if plane is not None else _far(file.shapes)
    return _shift_shapes(file, shift, file.origin if shift == (0.0, 0.0) else None)


def _from_degrees(file: ShapeFile, shapes: list[Polyline], crs: str, plane: LocalShapes | None) -> LocalShapes:
    """Convert shapes from degrees to metres of a local plane; longitudes must be continuous across the antimeridian."""
    if plane is not None and plane.origin is None:
        raise ValueError("the file has geographic coordinates, but the field does not; use one coordinate system")
    lon, lat = np.vstack([shape.points for shape in shapes]).T
    if np.abs(lat).max() > 90 >= np.abs(lon).max() and np.abs(lat).max() <= 360:
        swapped = replace(file, notes=(*file.notes, "the positions are read as latitude, longitude"))
        turned = [replace(shape, points=shape.points[:, ::-1]) for shape in shapes]
        return _from_degrees(swapped, turned, crs, plane)
    if np.abs(lat).max() > 90 or np.abs(lon).max() > 360:
        raise ValueError(
            "the coordinates are not latitudes and longitudes in degrees; specify another coordinate system with crs"
        )
    if plane is not None and plane.origin is not None:
        origin = plane.origin
        shapes = [replace(shape, points=_around(origin.longitude, shape.points)) for shape in shapes]
    else:
        origin = Origin(round(float(lat.min() + lat.max()) / 2, 7), round(float(lon.min() + lon.max()) / 2, 7))
    moved = [replace(shape, points=local_points(origin, shape.points[:, 1], shape.points[:, 0])) for shape in shapes]
    checked_extent(moved)
    wrapped = Origin(origin.latitude, (origin.longitude + 180) % 360 - 180)
    return LocalShapes(tuple(moved), wrapped, crs, (0.0, 0.0), file.name, file.notes)


def _geographic(file: ShapeFile, crs: str) -> tuple[ShapeFile, list[Polyline]]:
    """Return a file and its shapes in degrees. East and north are swapped if only the other order is in the area of the
    coordinate system."""
    shapes = [shape for shape in file.shapes if len(shape.points)]
    if crs != DEGREES:
        convert = _converter(crs)
        try:
            shapes = [replace(shape, points=convert(shape.points)) for shape in shapes]
        except ValueError as error:
            try:
                shapes = [replace(shape, points=convert(shape.points[:, ::-1])) for shape in shapes]
            except ValueError:
                raise error from None
            note = f"east and north are swapped, because only the other order is in the area of {crs[:60]}"
            file = replace(file, notes=(*file.notes, note))
    lon = np.concatenate([shape.points[:, 0] for shape in shapes])
    if np.ptp(lon) > 180:
        shapes = [
            replace(shape, points=np.column_stack([shape.points[:, 0] % 360, shape.points[:, 1]])) for shape in shapes
        ]
    return file, shapes


def _around(longitude: float, points: Array) -> Array:
    """Return the points in degrees with their longitudes shifted to within 180 deg of `longitude`."""
    return np.column_stack([longitude + (points[:, 0] - longitude + 180) % 360 - 180, points[:, 1]])


def _converter(crs: str) -> Callable[[Array], Array]:
    pyproj = import_extra("pyproj", "fields", f"the coordinate system {crs[:40]}")
    try:
        transformer = pyproj.Transformer.from_crs(crs, DEGREES, always_xy=True)
    except pyproj.exceptions.ProjError:
        raise ValueError(f"crs: {crs[:60]!r} is an unknown coordinate system; use a code like EPSG:25832") from None

    area = transformer.source_crs.area_of_use

    def converted(points: Array) -> Array:
        found: Array = np.column_stack(transformer.transform(points[:, 0], points[:, 1]))
        if not np.isfinite(found).all() or (area and _degrees_outside(found, area) > OUTSIDE_DEG):
            raise ValueError(
                f"the file has coordinates outside the area of {crs[:60]}; correct the coordinate system, or the order "
                "of east and north"
            )
        return found

    return converted


def _degrees_outside(points: Array, area: Any) -> float:
    """Return the maximum difference in latitude or longitude between points, shape (n, 2) [deg], and the area of use of
    a coordinate system; negative for points inside the area."""
    lon, lat = points.T
    half = (area.east - area.west) % 360 / 2 or 180.0
    east = np.abs((lon - area.west - half + 180) % 360 - 180) - half
    return float(np.max([area.south - lat, lat - area.north, east]))


def _far(shapes: Iterable[Polyline]) -> tuple[float, float]:
    """Return the offset [m] to subtract from coordinates that are far from their origin, or (0, 0) for coordinates near
    their origin."""
    points = np.vstack([shape.points for shape in shapes if len(shape.points)])
    if np.hypot(*points.T).min() <= FAR_M:
        return 0.0, 0.0
    east, north = np.round((points.min(axis=0) + points.max(axis=0)) / 2)
    return float(east), float(north)


def _shift_shapes(file: ShapeFile, shift: tuple[float, float], origin: Origin | None) -> LocalShapes:
    moved = [replace(shape, points=shape.points - shift) if any(shift) else shape for shape in file.shapes]
    extent = checked_extent(moved)
    if 0 < extent < SMALLEST_M:
        raise ValueError(
            f"the points extend over only {extent:.2g} m; if the numbers are degrees, name the columns lat, lon or set "
            "crs to EPSG:4326"
        )
    told = f"({shift[0]:.0f}, {shift[1]:.0f}) m is subtracted from all coordinates" if any(shift) and not origin else ""
    return LocalShapes(tuple(moved), origin, "", shift, file.name, (*file.notes, *([told] if told else [])))


def checked_extent(shapes: Iterable[Polyline]) -> float:
    """Return the maximum extent of shapes to the east or north [m]. Raise ValueError above LARGEST_M."""
    extent = float(np.ptp(np.vstack([shape.points for shape in shapes if len(shape.points)]), axis=0).max())
    if extent > LARGEST_M:
        raise ValueError(
            f"the points extend over {extent / 1000:.4g} km, more than {LARGEST_M / 1000:g} km; remove distant points"
        )
    return extent
