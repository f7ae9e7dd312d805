"""File formats of fields and plans in addition to the formats of `agrobot_mj.paths.imports`."""

from agrobot_mj.extensions.fields.formats.fields2cover import is_fields2cover, read_fields2cover
from agrobot_mj.extensions.fields.formats.gml import read_gml
from agrobot_mj.extensions.fields.formats.isoxml import read_task_data
from agrobot_mj.extensions.fields.formats.wkt import is_wkt, read_wkt
from agrobot_mj.paths.imports.reading import Readers

READERS: Readers = {
    "ISO 11783": (lambda head: "<ISO11783_TaskData" in head or "<XFC" in head, read_task_data),
    "GML": (lambda head: "opengis.net/gml" in head, read_gml),
    "WKT": (is_wkt, read_wkt),
    "Fields2Cover": (is_fields2cover, read_fields2cover),
}
"""Pairs of functions by format name: a test of the first characters of a file, and a reader of its text."""
