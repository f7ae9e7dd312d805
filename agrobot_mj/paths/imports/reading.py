"""Reading of position files. The first characters identify the file type; other text files are read as tables."""

import csv
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from warnings import catch_warnings

from agrobot_mj.core.errors import import_extra
from agrobot_mj.core.resources import checked_path, refuse
from agrobot_mj.paths.imports.agopengps import HEADS, read_agopengps
from agrobot_mj.paths.imports.geojson import SCRIPT, of_geometry, read_geojson
from agrobot_mj.paths.imports.shapes import DEGREES, ShapeFile
from agrobot_mj.paths.imports.table import read_table
from agrobot_mj.paths.imports.xml_files import read_gpx, read_kml

MAX_BYTES = 100_000_000  # Maximum size of a file [bytes]
SHP = b"\x00\x00\x27\x0a"
HEAD_CHARACTERS = 2000  # Number of first characters used to recognise the type of a text file
TextReader = Callable[[str], ShapeFile]
Readers = dict[str, tuple[Callable[[str], bool], TextReader]]
READERS: Readers = {
    "KML": (lambda head: "<kml" in head or "/kml/" in head, read_kml),
    "GPX": (lambda head: "<gpx" in head, read_gpx),
    "GeoJSON": (lambda head: head.lstrip()[:1] in ("{", "[") or bool(SCRIPT.match(head)), read_geojson),
    "AgOpenGPS": (lambda head: any(name in head for name in HEADS), read_agopengps),
}
"""Functions by file type: one that tests the first characters of a text file, and one that reads the text."""


def read_shapes(name: str, most_bytes: int = MAX_BYTES, more: Readers | None = None) -> ShapeFile:
    """Return the shapes of the file `name`. Raise a ValueError that names file, problem and fix for an invalid file."""
    path = checked_path(name, (), most_bytes)
    try:
        data = path.read_bytes()
    except OSError as error:
        refuse(path, f"cannot be read: {error.strerror}; choose another file")
    try:
        if data.startswith(SHP):
            return read_shapefile(path)
        return _read_text(decode(data), {**(more or {}), **READERS})
    except (ValueError, csv.Error) as error:
        refuse(path, str(error))


def decode(data: bytes) -> str:
    """Return the text of a file in UTF-8, UTF-16 or Windows-1252. Raise ValueError for other content."""
    for codec in ("utf-16",) if data.startswith((b"\xff\xfe", b"\xfe\xff")) else ("utf-8-sig", "cp1252"):
        try:
            text = data.decode(codec)
        except UnicodeDecodeError:
            continue
        if "\x00" not in text:
            return text
    raise ValueError(
        "the file is not text, or contains null bytes; save it as CSV (columns x, y or lat, lon), GeoJSON, KML, GPX "
        "or a shapefile (.shp)"
    )


def text_type(text: str, readers: Readers = READERS) -> str:
    """Return the type of a text file with positions, such as "KML", or "" for a table or an unknown type."""
    head = text[:HEAD_CHARACTERS]
    return next((name for name, (recognises, _) in readers.items() if recognises(head)), "")


def _read_text(text: str, readers: Readers) -> ShapeFile:
    if name := text_type(text, readers):
        return readers[name][1](text)
    if text.lstrip().startswith("<"):
        raise ValueError(f"the file is XML of an unknown type; convert it to one of {', '.join(readers)}")
    return read_table(text)


MOST_PRJ_BYTES = 100_000  # Maximum size of a .prj file [bytes]


def read_shapefile(path: Path) -> ShapeFile:
    """Return the shapes of a shapefile. Raise ValueError if the file is damaged."""
    shapefile = import_extra("shapefile", "fields", "a shapefile")
    shapefile.VERBOSE = False  # rings in the wrong order are read anyway
    try:
        with ExitStack() as opened, catch_warnings(action="ignore"):
            shp = opened.enter_context(path.open("rb"))  # without the .shx file, whose damage would omit shapes
            reader = shapefile.Reader(shp=shp)
            surfaces = reader.shapeType == shapefile.MULTIPATCH
            geometries = [] if surfaces else [shape.__geo_interface__ for shape in reader.iterShapes()]
            table = _part(path, ".dbf")
            records = _records(shapefile, table) if table else []
    except Exception as error:  # the library raises many types for damaged files
        raise ValueError(f"the shapefile is damaged ({type(error).__name__}); export the file again") from None
    if surfaces:
        raise ValueError("the shapefile contains 3D surfaces (MULTIPATCH); export polygons or lines")
    shapes = tuple(
        shape
        for k, geometry in enumerate(geometries)
        for shape in of_geometry(geometry, records[k] if k < len(records) else {})
    )
    crs = _crs(path)
    notes = () if crs else ("there is no .prj file, so the coordinates are assumed to be in metres",)
    return ShapeFile(shapes, crs, name=shapes[0].name if shapes else "", notes=notes)


def _part(path: Path, end: str) -> Path | None:
    """Return the file of a shapefile that ends in `end`, in lower or upper case, or None."""
    return next((file for each in (end, end.upper()) if (file := path.with_suffix(each)).is_file()), None)


def _records(shapefile: Any, file: Path) -> list[dict[str, Any]]:
    """Return the records of a .dbf file in UTF-8 or, if the text is not UTF-8, in Windows-1252."""
    try:
        return _decoded_records(shapefile, file, "utf-8", "strict")
    except (UnicodeDecodeError, shapefile.ShapefileException):
        return _decoded_records(shapefile, file, "cp1252", "replace")


def _decoded_records(shapefile: Any, file: Path, encoding: str, errors: str) -> list[dict[str, Any]]:
    with file.open("rb") as dbf, shapefile.Reader(dbf=dbf, encoding=encoding, encodingErrors=errors) as reader:
        names = [each[0] for each in reader.fields[1:]]
        return [dict(zip(names, record, strict=False)) for record in reader.iterRecords()]


def _crs(path: Path) -> str:
    file = _part(path, ".prj")
    if file is None or file.stat().st_size > MOST_PRJ_BYTES:
        return ""
    pyproj = import_extra("pyproj", "fields", "the coordinate system of a shapefile")
    try:
        crs = pyproj.CRS.from_wkt(file.read_text(encoding="utf-8", errors="replace"))
    except pyproj.exceptions.CRSError:
        raise ValueError(f"{file.name}: the coordinate system is unknown; specify it with crs") from None
    code = crs.to_epsg(min_confidence=70)
    return DEGREES if code == 4326 else f"EPSG:{code}" if code else str(crs.to_wkt())
