"""Remarks on rankings of laws: inconsistent estimates, and cross-track errors dominated by estimation errors."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean, median
from typing import Any

import pyarrow.parquet as pq

from agrobot_mj.metrics.success import error_of

ESTIMATOR, GUIDANCE = "xte_estimator_rms", "xte_guidance_rms"
Row = Mapping[str, Any]


def remarks(cases: Mapping[str, Sequence[Row]]) -> list[str]:
    """Return remarks on each group of runs: dominant estimation errors, and warnings about the estimates."""
    rows = [row for some in cases.values() for row in some]
    return [*([text] if (text := _dominance(cases, rows)) else []), *_warnings(rows)]


def _dominance(cases: Mapping[str, Sequence[Row]], rows: Sequence[Row]) -> str:
    parts = [(row, error_of(row, ESTIMATOR), error_of(row, GUIDANCE)) for row in rows]
    known = [(row, estimator, guidance) for row, estimator, guidance in parts if estimator is not None and guidance]
    led = [row for row, estimator, guidance in known if estimator > guidance]
    if len(cases) < 2 or 2 * len(led) <= len(known):
        return ""
    texts = ([row.get(name) or "" for row in led] for name in ("xte_cause", "xte_remedy"))
    cause, remedy = (Counter(each).most_common(1)[0][0] for each in texts)
    about = f" ({cause})" if cause else ""
    text = f"the estimator causes the larger part of the cross-track error in {len(led)} of {len(known)} runs{about}; "
    text += f"a ranking by this error compares estimates, not guidance laws; {_ahead(cases)}"
    return f"{text}; {remedy}" if remedy else text


def _ahead(cases: Mapping[str, Sequence[Row]]) -> str:
    medians = {
        name: median(values)
        for name, rows in cases.items()
        if (values := [value for row in rows if (value := error_of(row, GUIDANCE)) is not None])
    }
    best = min(medians, key=lambda name: medians[name])
    return f"the median of the guidance part is smallest for {best}, {100 * medians[best]:.1f} cm"


def _warnings(rows: Sequence[Row]) -> list[str]:
    warned = [text for row in rows if (text := row.get("estimate_warning"))]
    if not warned:
        return []
    first = ", the first:" if len(warned) > 1 else ""
    return [f"in {len(warned)} of {len(rows)} runs{first} {warned[0]}"]


def table_warnings(table: Path) -> list[str]:
    """Return one sentence about the estimate warnings in a sweep table, as a list that is empty if there are no
    warnings."""
    column = "estimate_warning"
    if not table.is_file() or column not in pq.read_schema(table.absolute()).names:
        return []
    return _warnings(pq.read_table(table.absolute(), columns=[column]).to_pylist())


def mean_nees(rows: Sequence[Row]) -> float | str:
    """Return the mean position NEES of runs [-] if the estimate of at least one run is inconsistent, otherwise ""."""
    values = [value for row in rows if (value := row.get("position_nees")) is not None]
    return fmean(values) if values and any(row.get("estimate_warning") for row in rows) else ""
