"""Ranking of groups of runs: rates of success with their intervals, errors of the successful runs, remarks.

First by the rate of success (runs that ended as expected), then by the median of the cross-track rms of these.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.cbook import boxplot_stats

from agrobot_mj.core.signals import Array
from agrobot_mj.metrics.success import error_of, failures, succeeded
from agrobot_mj.studies.error_parts import ESTIMATOR, GUIDANCE, mean_nees, remarks
from agrobot_mj.studies.pages.document import CATEGORIES, Chart, Document, layout
from agrobot_mj.studies.statistics import wilson_interval

CENTIMETRES = 100.0
METRIC, LABEL = "xte_rms", "cross-track rms [cm]"
CONFIDENCE = 0.8
"""Confidence of the intervals of success rates [-]."""
QUANTILES = ("median", "10 %", "90 %")
"""Columns of the errors of a group."""
MEDIANS = {ESTIMATOR: "estimator [cm]", GUIDANCE: "guidance [cm]", "xte_abs_p95": "xte 95 % [cm]"}
MEDIANS |= {"lateral_rms": "lateral rms [cm]"}
"""Errors of which the ranking has medians, parts of the metric first, and their heads."""
FEW = 5
"""Runs of a group up to which a box shows each of them."""
Row = Mapping[str, Any]


class Group(NamedTuple):
    """Rows that belong together."""

    name: str
    rows: Sequence[Row]

    @property
    def rate(self) -> float:
        """Fraction of runs that ended as expected [-]."""
        return sum(map(succeeded, self.rows)) / len(self.rows)

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of the success rate at `CONFIDENCE` [-]."""
        return wilson_interval(sum(map(succeeded, self.rows)), len(self.rows), CONFIDENCE)

    @property
    def values(self) -> Array:
        """Error of the group's successful runs [cm]."""
        return centimetres(self.rows)


def centimetres(rows: Iterable[Row]) -> Array:
    """Return the error of the rows that have one [cm]."""
    return np.array([CENTIMETRES * error for row in rows if (error := error_of(row, METRIC)) is not None])


def ranked(groups: Iterable[Group]) -> list[Group]:
    """Return the groups, the best first."""
    return sorted(groups, key=lambda group: (-group.rate, np.median(group.values) if len(group.values) else np.inf))


def add_ranking(page: Document, groups: Sequence[Group], title: str, text: str, colours: Sequence[str]) -> None:
    """Add a table of the groups, best first, remarks, and boxes of their errors in some colours, taken in turn."""
    rule = "Success is to end as the scenario expects; the error is that of the successful runs that completed."
    page.section(title, f"{rule} {text}" if text else rule)
    head = ("group", "runs", "success [%]", f"{CONFIDENCE:.0%} interval", *(f"{q} [cm]" for q in QUANTILES))
    page.table((*head, *MEDIANS.values(), "NEES", "failed"), [_line(group) for group in groups])
    page.remarks(remarks({group.name: group.rows for group in groups}))
    if boxes := [box(group, colours[k % len(colours)]) for k, group in enumerate(groups) if len(group.values)]:
        page.grid([("Error of the successful runs", {"data": boxes, "layout": layout(LABEL, "", yaxis=CATEGORIES)})])


def box(group: Group, colour: str) -> Chart:
    """Return the box of a group's errors, with the quartiles of the figure for print: plotly.js would reckon them
    otherwise."""
    (found,) = boxplot_stats(group.values)
    names = {"q1": "q1", "med": "median", "q3": "q3", "whislo": "lowerfence", "whishi": "upperfence"}
    drawn = {theirs: [float(found[ours])] for ours, theirs in names.items()}
    common = {"type": "box", "orientation": "h", "name": group.name, "showlegend": False}
    points = {
        "x": [group.values.tolist()],
        "y": [group.name.replace(", ", ",<br>")],
        "boxpoints": "all" if len(group.values) <= FEW else "outliers",
        "pointpos": 0,
    }
    return common | drawn | points | {"marker": {"color": colour, "size": 3}}


def _line(group: Group) -> tuple[object, ...]:
    values = [float(f"{v:.3g}") for v in np.percentile(group.values, (50, 10, 90))] if len(group.values) else [None] * 3
    interval = " to ".join(f"{100 * end:.0f}" for end in group.interval)
    medians = [_median([error_of(row, name) for row in group.rows]) for name in MEDIANS]
    ends = *medians, mean_nees(group.rows), failures(group.rows)
    return (group.name, len(group.rows), 100.0 * group.rate, interval, *values, *ends)


def _median(errors: Iterable[float | None]) -> float | None:
    """Return the median of the available errors [cm]."""
    known = [error for error in errors if error is not None]
    return float(f"{CENTIMETRES * np.median(known):.3g}") if known else None
