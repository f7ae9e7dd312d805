"""Description of a log as text: reader, columns with rates and gaps, and possible uses."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import tomli_w

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import UNPRINTABLE
from agrobot_mj.core.table_columns import FieldLogError, Source, column_names, load_table, read_columns
from agrobot_mj.extensions.logs.checks import check_columns
from agrobot_mj.extensions.logs.health import health_lines
from agrobot_mj.extensions.logs.maps import LogMap, TimeColumn, named_columns
from agrobot_mj.extensions.logs.pieces import pieces
from agrobot_mj.extensions.logs.readers import OpenedLog
from agrobot_mj.extensions.logs.recording import SECONDS, read_recording

MOST_COLUMNS = 60  # Maximum number of columns that are described
TIME = re.compile(r"(?:.*[\W_])?(?:t|time|timestamp|stamp)(?:[\W_]*(s|ms|us|ns)\W*|\W.*)?", re.I | re.A)
"""Pattern of the name of a time column, with its unit if the name ends in a unit."""
PLACEHOLDERS = {
    "speed": {"column": "...", "unit": "m/s"},
    "steer": {"column": "...", "unit": "deg"},
    "yaw_rate": {"column": "...", "unit": "deg/s"},
    "position": {"east": "...", "north": "..."},
}
"""Template of a column map for a log with unknown columns; the user replaces each `...` by a column name."""


def coverage(t: Array, values: Array) -> tuple[int, float, float]:
    """Return the number of values of a column, their rate from the median time step [Hz], and their longest gap [s].

    Missing `values` and times `t`, shape (n,) each, are NaN.
    """
    known = t[np.isfinite(values) & np.isfinite(t)]
    if len(known) < 2:
        return len(known), 0.0, 0.0
    steps = np.diff(known)
    return len(known), 1.0 / max(float(np.median(steps)), 1e-9), float(steps.max())


def describe(log: OpenedLog, log_map: LogMap | None = None) -> str:
    """Return a description of a log as plain text that is also valid Markdown. `log_map` is the user's column map, or
    None."""
    source, m = load_table(log.source), log_map or log.log_map
    names = [name for name in column_names(source) if not m or name != m.time.column][:MOST_COLUMNS]
    tables = {} if m else log.tables or _template(source, names)
    at = m.time if m else TimeColumn(**tables["time"]) if tables else None
    lines = [f"{log.name}: read as {log.reader}", *log.notes]
    if at:
        t = read_columns(source, [at.column])[at.column] * SECONDS[at.unit]
        lines[0] += f", {np.ptp(t[np.isfinite(t)]):.1f} s" if len(t) else ", no rows"
        head = ("column", "unit", "values", "rate Hz", "longest gap s", "minimum", "maximum")
        rows = [_row(source, name, t) for name in names if name != at.column]
        lines += ["", *markdown_table(head, rows, 2, aligned=True).splitlines(), ""]
    else:
        lines.append(f"columns: {', '.join(names)}")
    if m:
        keys = named_columns(m)
        qualities = {part.quality for part in (m.position, m.heading) if part is not None}  # numbers or words
        read_columns(source, [column for column in keys if column not in qualities], keys)
        used = ", ".join(f"{key} = {column}" for column, key in keys.items())
        lines += health_lines([source], m)
        lines.append(f"{_use(source, m)}: {used}.")
    else:
        lines.append(f"The log cannot be used for replay, identify or calibrate: {log.missing}.")
    if tables:
        lines += ["", "Template of a map:", "", *tomli_w.dumps(tables).splitlines()]
    return "\n".join(UNPRINTABLE.sub("?", line) for line in lines)


def _template(source: Source, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return column-map tables with a time column, recognised by its name, and placeholders for other columns. Return
    {} if there is no time column."""
    for name in names:
        if (match := TIME.fullmatch(name)) and _increases(source, name):
            return {"time": {"column": name, "unit": (match[1] or "s").lower()}, **PLACEHOLDERS}
    return {}


def _increases(source: Source, name: str) -> bool:
    try:
        t = read_columns(source, [name])[name]
    except FieldLogError:
        return False
    known = t[np.isfinite(t)]
    return len(known) > 1 and bool((np.diff(known) >= 0.0).all()) and bool(known[-1] > known[0])


def _use(source: Source, m: LogMap) -> str:
    """Return a text that names the possible uses of a log with the column map `m`, and the reason why other uses are
    impossible."""
    enough = "The log has the columns for"
    try:
        kept = pieces([read_recording(source, m, 0.0)]).kept
    except FieldLogError as error:
        return f"The log cannot be used for replay, identify or calibrate ({error})"
    if m.steer is None:
        return f"{enough} replay"
    try:
        check_columns(kept)
    except FieldLogError as error:
        return f"{enough} replay, but not for identify and calibrate ({error})"
    return f"{enough} replay, identify and calibrate"


def _row(source: Source, name: str, t: Array) -> tuple[str, ...]:
    """Return the table row of a column: name, unit, number of values, rate, longest gap, minimum and maximum."""
    try:
        values = read_columns(source, [name])[name]
    except FieldLogError:
        return name, "", "no numbers", "", "", "", ""
    (count, rate, gap), known = coverage(t, values), values[np.isfinite(values)]
    ends = (f"{known.min():.7g}", f"{known.max():.7g}") if len(known) else ("", "")
    return name, _unit(source, name), str(count), f"{rate:.3g}", f"{gap:.3g}", *ends


def _unit(source: Source, name: str) -> str:
    """Return the unit from the metadata of a column, or an empty string."""
    schema = source.schema if isinstance(source, pa.Table) else pq.read_schema(source.absolute())
    return ((schema.field(name).metadata or {}).get(b"unit") or b"").decode(errors="replace")
