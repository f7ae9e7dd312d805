"""ESRI shapefiles: the .shp, with the coordinate system of the .prj and the properties of the .dbf next to it."""

from pathlib import Path
from warnings import catch_warnings

from agrobot_mj.core.errors import required
from agrobot_mj.paths.imports.geojson import of_geometry
from agrobot_mj.paths.imports.shapes import DEGREES, ShapeFile

MOST_PRJ_BYTES = 100_000
"""Maximum size of a .prj file [bytes]."""


def read_shapefile(path: Path) -> ShapeFile:
    """Return the shapes of a shapefile. Raise ValueError if it is damaged."""
    shapefile = required("shapefile", "fields", "a shapefile")
    shapefile.VERBOSE = False  # rings in the wrong order are read anyway
    try:
        with catch_warnings(action="ignore"), shapefile.Reader(shp=str(path), **_parts(path)) as reader:
            names = [each[0] for each in reader.fields[1:]]
            records = [dict(zip(names, record, strict=False)) for record in reader.iterRecords()] if names else []
            geometries = [shape.__geo_interface__ for shape in reader.iterShapes()]
    except Exception as error:  # the library raises many types for damaged files
        raise ValueError(f"the shapefile is damaged ({type(error).__name__}); export it again") from None
    shapes = tuple(
        shape
        for k, geometry in enumerate(geometries)
        for shape in of_geometry(geometry, records[k] if k < len(records) else {})
    )
    crs = _crs(path)
    notes = () if crs else ("there is no .prj file, so the coordinates are assumed to be in metres",)
    return ShapeFile(shapes, crs, name=shapes[0].name if shapes else "", notes=notes)


def _parts(path: Path) -> dict[str, str]:
    found = {end: path.with_suffix(f".{end}") for end in ("shx", "dbf")}
    return {end: str(file) for end, file in found.items() if file.is_file()}


def _crs(path: Path) -> str:
    file = path.with_suffix(".prj")
    if not file.is_file() or file.stat().st_size > MOST_PRJ_BYTES:
        return ""
    pyproj = required("pyproj", "fields", "the coordinate system of a shapefile")
    try:
        crs = pyproj.CRS.from_wkt(file.read_text(encoding="utf-8", errors="replace"))
    except pyproj.exceptions.CRSError:
        raise ValueError(f"{file.name}: the coordinate system is unknown; specify it with crs") from None
    code = crs.to_epsg(min_confidence=70)
    return DEGREES if code == 4326 else f"EPSG:{code}" if code else str(crs.to_wkt())
