"""Definition of a successful run, used by averages, rankings and searches.

A run is a *success* if it ended as its scenario expects. Only successful runs that completed their path have valid
tracking errors: a run that stops after a second has small errors, which are not comparable.

A row is a mapping with `outcome`, the metrics of a run, and `expected`, which states whether the run is a success.
Studies in which all scenarios expect `completed` may omit `expected`.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from typing import Any

COMPLETED = "completed"  # Outcome of a run that reached the end of its path
ERRORS = (
    *("lateral_", "longitudinal_", "xte_", "yaw_rate_error_", "implement_xte_", "per_turn", "iso_12188_2_style"),
    *("acquisition", "steer_error_"),
)
"""Prefixes of the names of metrics that are tracking errors."""
MOST_REASONS = 3  # Maximum number of different outcomes and reasons in a text
Row = Mapping[str, Any]


def is_success(row: Row) -> bool:
    """Return whether a run ended with the outcome that its scenario expects; by default the outcome `completed`."""
    return bool(row["expected"] if "expected" in row else row["outcome"] == COMPLETED)


def has_errors(row: Row) -> bool:
    """Return whether the tracking errors of a run are valid: the run completed its path, as its scenario expects."""
    return is_success(row) and row["outcome"] == COMPLETED


def error_of(row: Row, name: str) -> float | None:
    """Return the tracking error `name` of a run, or None if the error is invalid, missing or not finite."""
    value = row.get(name) if has_errors(row) else None
    return float(value) if value is not None and isfinite(value) else None


def is_error(name: str) -> bool:
    """Return whether the metric `name` is a tracking error."""
    return name.startswith(ERRORS)


def without_errors(row: Row) -> dict[str, Any]:
    """Return a copy of a row in which invalid tracking errors are None."""
    counts = has_errors(row)
    return {name: value if counts or not is_error(name) else None for name, value in row.items()}


def failures(rows: Sequence[Row]) -> str:
    """Return a text about failed runs, such as `2 of 5: 1 stopped (no GNSS fix), 1 diverged`, or an empty string."""
    failed = [row for row in rows if not is_success(row)]
    return f"{len(failed)} of {len(rows)}: {reasons(failed)}" if failed else ""


def reasons(rows: Iterable[Row]) -> str:
    """Return a text with the counts of outcomes and reasons in `rows`, most frequent first."""
    ends: dict[str, list[Row]] = {}
    for row in rows:
        # Outcomes whose reasons differ only in their numbers are counted together.
        ends.setdefault(re.sub(r"\d+(\.\d+)?", "", _end(row)), []).append(row)
    found = [f"{len(some)} {_end(some[0])}" for some in sorted(ends.values(), key=len, reverse=True)]
    return ", ".join([*found[:MOST_REASONS], *(["..."] if len(found) > MOST_REASONS else [])])


def _end(row: Row) -> str:
    reason = row.get("stop_reason") or (row.get("error") or "").partition("\n")[0]
    return f"{row['outcome']} ({reason})" if reason else str(row["outcome"])
