"""Reading of position files: the type is recognised by the content, or by the file ending if that is ambiguous."""

import csv
from collections.abc import Callable

from agrobot_mj.core.resources import checked, refuse
from agrobot_mj.paths.imports.agopengps import HEADS, read_agopengps
from agrobot_mj.paths.imports.geojson import read_geojson
from agrobot_mj.paths.imports.shapefile_files import read_shapefile
from agrobot_mj.paths.imports.shapes import ShapeFile
from agrobot_mj.paths.imports.table import read_table
from agrobot_mj.paths.imports.xml_files import read_gpx, read_kml

MAX_BYTES = 100_000_000
"""Maximum size of a file [bytes]."""
SHP = b"\x00\x00\x27\x0a"
HEAD_CHARACTERS = 2000
"""Number of characters from which the type of a text file is recognised."""
TextReader = Callable[[str], ShapeFile]
Readers = dict[str, tuple[Callable[[str], bool], TextReader]]
READERS: Readers = {
    "KML": (lambda head: "<kml" in head or "/kml/" in head, read_kml),
    "GPX": (lambda head: "<gpx" in head, read_gpx),
    "GeoJSON": (lambda head: head.lstrip()[:1] in ("{", "["), read_geojson),
    "AgOpenGPS": (lambda head: any(name in head for name in HEADS), read_agopengps),
}
"""Readers of text files, each with a test of the first characters; other files are read as tables."""


def read_shapes(name: str, most_bytes: int = MAX_BYTES, more: Readers | None = None) -> ShapeFile:
    """Return the shapes of a file. Raise ValueError that names the file, the problem and the fix."""
    path = checked(name, (), most_bytes)
    try:
        data = path.read_bytes()
    except OSError as error:
        refuse(path, f"cannot be read: {error.strerror}; choose another file")
    try:
        if data.startswith(SHP):
            return read_shapefile(path)
        return _read_text(_decoded(data), {**(more or {}), **READERS})
    except (ValueError, csv.Error) as error:
        refuse(path, str(error))


def _decoded(data: bytes) -> str:
    for codec in ("utf-16",) if data.startswith((b"\xff\xfe", b"\xfe\xff")) else ("utf-8-sig",):
        try:
            text = data.decode(codec)
        except UnicodeDecodeError:
            continue
        if "\x00" not in text:
            return text
    raise ValueError(
        "the file is not UTF-8 text; save it as CSV (columns x, y or lat, lon), GeoJSON, KML, GPX or a shapefile (.shp)"
    )


def _read_text(text: str, readers: Readers) -> ShapeFile:
    head = text[:HEAD_CHARACTERS]
    for recognises, read in readers.values():
        if recognises(head):
            return read(text)
    if head.lstrip().startswith("<"):
        raise ValueError(f"the file is XML of an unknown type; convert it to one of {', '.join(readers)}")
    return read_table(text)
