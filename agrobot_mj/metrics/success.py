"""The rule on runs that failed, for all that averages, ranks or searches over runs.

A run is a *success* if it ended as its scenario expects. A tracking error exists only for a success that completed its
path: a run that was stopped after a second has small errors, and none that could be compared.

A row is a mapping with `outcome`, a run's metrics, and `expected`: whether it is a success. Rows of studies whose
scenarios all expect `completed` may lack that.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from typing import Any

COMPLETED = "completed"
"""Outcome of a run that drove its path to the end."""
ERRORS = (
    *("lateral_", "longitudinal_", "xte_", "yaw_rate_error_", "implement_xte_", "per_turn", "iso_12188_2_style"),
    *("acquisition", "steer_error_"),
)
"""Prefixes of the names of tracking errors."""
MOST_REASONS = 3
"""Reasons that a text lists."""
Row = Mapping[str, Any]


def succeeded(row: Row) -> bool:
    """Whether a run ended as its scenario expects."""
    return bool(row["expected"] if "expected" in row else row["outcome"] == COMPLETED)


def has_errors(row: Row) -> bool:
    """Whether the tracking errors of a run count: it completed its path, as it was expected to."""
    return succeeded(row) and row["outcome"] == COMPLETED


def error_of(row: Row, name: str) -> float | None:
    """The tracking error `name` of a run; None where it does not count or has no finite value."""
    value = row.get(name) if has_errors(row) else None
    return float(value) if value is not None and isfinite(value) else None


def is_error(name: str) -> bool:
    """Whether a metric is a tracking error."""
    return name.startswith(ERRORS)


def without_errors(row: Row) -> dict[str, Any]:
    """A copy of a row, its tracking errors None if they do not count."""
    counts = has_errors(row)
    return {name: value if counts or not is_error(name) else None for name, value in row.items()}


def failures(rows: Sequence[Row]) -> str:
    """How many of some runs failed, and how, as `2 of 5: 1 stopped (no GNSS fix), 1 diverged`; empty if none did."""
    failed = [row for row in rows if not succeeded(row)]
    return f"{len(failed)} of {len(rows)}: {reasons(failed)}" if failed else ""


def reasons(rows: Iterable[Row]) -> str:
    """The different ends of some runs, with how often and why, the most frequent first."""
    ends: dict[str, list[Row]] = {}
    for row in rows:
        # Numbers aside, that of a reason for instance, so that equal ends count together.
        ends.setdefault(re.sub(r"\d+(\.\d+)?", "", _end(row)), []).append(row)
    found = [f"{len(some)} {_end(some[0])}" for some in sorted(ends.values(), key=len, reverse=True)]
    return ", ".join([*found[:MOST_REASONS], *(["..."] if len(found) > MOST_REASONS else [])])


def _end(row: Row) -> str:
    reason = row.get("stop_reason") or (row.get("error") or "").partition("\n")[0]
    return f"{row['outcome']} ({reason})" if reason else str(row["outcome"])
