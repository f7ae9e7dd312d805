"""What a log holds, in words: who reads it, its columns with their rates and gaps, and what it can be used for."""

from typing import NamedTuple

import numpy as np
import pyarrow as pa
import tomli_w

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import Array
from agrobot_mj.fieldlogs.columns import FieldLogError, column_names, read_columns
from agrobot_mj.fieldlogs.maps import LogMap, named_columns
from agrobot_mj.fieldlogs.readers import QUANTITIES, OpenedLog
from agrobot_mj.fieldlogs.recording import SECONDS

UNITS = {quantity.name: quantity.unit for quantity in QUANTITIES}


class Coverage(NamedTuple):
    """How a column fills its time."""

    values: int
    rate: float
    """Values over the time from the first to the last [Hz]; the median step counts, so that gaps do not."""
    gap: float
    """Longest time without a value [s]."""


def coverage(t: Array, values: Array) -> Coverage:
    """Coverage of a column, `t` and `values` of shape (n,), NaN where there is none."""
    known = t[np.isfinite(values)]
    if len(known) < 2:
        return Coverage(len(known), 0.0, 0.0)
    steps = np.diff(known)
    return Coverage(len(known), 1.0 / max(float(np.median(steps)), 1e-9), float(steps.max()))


def describe(log: OpenedLog, log_map: LogMap | None = None) -> str:
    """The log in a few lines and a table, as plain text and valid Markdown; `log_map` is the user's, if any."""
    names, m = column_names(log.source), log_map or log.log_map
    time, unit = (m.time.column, m.time.unit) if m else ("t", "s")
    lines = [f"{log.name}: read as {log.reader}", *log.notes]
    if time in names:
        t = read_columns(log.source, [time])[time] * SECONDS[unit]
        lines[0] += f", {np.ptp(t):.1f} s" if len(t) else ", no rows"
        head = ("column", "unit", "values", "rate Hz", "longest gap s", "least", "largest")
        table = markdown_table(head, [_row(log, name, t) for name in names if name != time], 2, aligned=True)
        lines += ["", table, ""]
    else:
        lines.append(f"columns: {', '.join(names)}")
    if m:
        used = ", ".join(f"{key} = {column}" for column, key in named_columns(m).items())
        return "\n".join([*lines, f"Enough for replay, identify --vehicle and calibrate: {used}."])
    lines.append(f"Not enough for replay, identify or calibrate: {log.missing}.")
    if log.tables:
        lines += ["", "A map to begin with:", "", tomli_w.dumps(log.tables)]
    return "\n".join(lines)


def _row(log: OpenedLog, name: str, t: Array) -> tuple[str, ...]:
    """One line of the table; a column that holds no numbers has none."""
    unit = UNITS.get(name, "") if isinstance(log.source, pa.Table) else ""
    try:
        values = read_columns(log.source, [name])[name]
    except FieldLogError:
        return name, unit, "no numbers", "", "", "", ""
    found, known = coverage(t, values), values[np.isfinite(values)]
    ends = (f"{known.min():.7g}", f"{known.max():.7g}") if len(known) else ("", "")
    return name, unit, str(found.values), f"{found.rate:.3g}", f"{found.gap:.3g}", *ends
