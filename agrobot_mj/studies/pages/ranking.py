"""Ranking of groups of runs: success rates with intervals, errors of successful runs, and remarks.

Groups are sorted by success rate, then by the median cross-track RMS error of the successful runs.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.cbook import boxplot_stats

from agrobot_mj.core.signals import Array
from agrobot_mj.metrics.success import error_of, failures, is_success
from agrobot_mj.studies.error_parts import ESTIMATOR, GUIDANCE, mean_nees, remarks
from agrobot_mj.studies.pages.document import CATEGORIES, Chart, Document, layout
from agrobot_mj.studies.statistics import wilson_interval

CENTIMETRES = 100.0
METRIC, LABEL = "xte_rms", "cross-track rms [cm]"
CONFIDENCE = 0.8  # Confidence level of the intervals for success rates [-]
QUANTILES = ("median", "10 %", "90 %")  # Names of the columns with quantiles of the errors in a group
MEDIANS = {ESTIMATOR: "estimator [cm]", GUIDANCE: "guidance [cm]", "xte_abs_p95": "xte 95 % [cm]"}
MEDIANS |= {"lateral_rms": "lateral rms [cm]"}
"""Titles of the columns with medians of further errors, by metric. Components of the cross-track error are first."""
FEW, ABOVE = 5, -1.6
"""Maximum number of runs for which a box plot also shows every run as a point, and position of these points relative to
the centre of the box, in half heights of the box and downwards."""
Row = Mapping[str, Any]


class Group(NamedTuple):
    """Group of runs in a ranking, for example all runs of one law."""

    name: str
    rows: Sequence[Row]

    @property
    def rate(self) -> float:
        """Success rate of the group of runs: fraction of the runs that ended as expected [-]."""
        return sum(map(is_success, self.rows)) / len(self.rows)

    @property
    def interval(self) -> tuple[float, float]:
        """Confidence interval of the success rate [-] at the confidence level `CONFIDENCE`."""
        return wilson_interval(sum(map(is_success, self.rows)), len(self.rows), CONFIDENCE)

    @property
    def values(self) -> Array:
        """Cross-track RMS errors of the successful runs [cm]."""
        return centimetres(self.rows)


def centimetres(rows: Iterable[Row]) -> Array:
    """Return the cross-track RMS errors of the rows [cm], omitting rows without an error value."""
    return np.array([CENTIMETRES * error for row in rows if (error := error_of(row, METRIC)) is not None])


def rank_groups(groups: Iterable[Group]) -> list[Group]:
    """Return the groups of runs in ranking order, best group first."""
    return sorted(groups, key=lambda group: (-group.rate, np.median(group.values) if len(group.values) else np.inf))


def add_ranking(page: Document, groups: Sequence[Group], title: str, text: str, colours: Sequence[str]) -> None:
    """Add a table of the groups of runs, remarks, and box plots of the errors in the given colours to a page."""
    rule = "A run succeeds if it ends as the scenario expects. Errors refer to successful runs that completed."
    page.section(title, f"{rule} {text}" if text else rule)
    head = ("group", "runs", "success [%]", f"{100 * CONFIDENCE:.0f} % interval", *(f"{q} [cm]" for q in QUANTILES))
    page.table((*head, *MEDIANS.values(), "NEES", "failed"), [_line(group) for group in groups])
    page.remarks(remarks({group.name: group.rows for group in groups}))
    if boxes := [box(group, colours[k % len(colours)]) for k, group in enumerate(groups) if len(group.values)]:
        page.grid([("Error of the successful runs", {"data": boxes, "layout": layout(LABEL, "", yaxis=CATEGORIES)})])


def box(group: Group, colour: str) -> Chart:
    """Return a box plot of the errors of a group of runs, with the same quartiles as `ranking.png`."""
    (found,) = boxplot_stats(group.values)
    names = {"q1": "q1", "med": "median", "q3": "q3", "whislo": "lowerfence", "whishi": "upperfence"}
    drawn = {theirs: [float(found[ours])] for ours, theirs in names.items()}
    common = {"type": "box", "orientation": "h", "name": group.name, "showlegend": False}
    every = len(group.values) <= FEW
    points = {
        "x": [group.values.tolist()],
        "y": [group.name.replace(", ", ",<br>")],
        "boxpoints": "all" if every else "outliers",
        "pointpos": ABOVE if every else 0,
    }
    return common | drawn | points | {"marker": {"color": colour, "size": 5}}


def _line(group: Group) -> tuple[object, ...]:
    values = [float(f"{v:.3g}") for v in np.percentile(group.values, (50, 10, 90))] if len(group.values) else [None] * 3
    interval = " to ".join(f"{100 * end:.0f}" for end in group.interval)
    medians = [_median([error_of(row, name) for row in group.rows]) for name in MEDIANS]
    ends = *medians, mean_nees(group.rows), failures(group.rows)
    return (group.name, len(group.rows), 100.0 * group.rate, interval, *values, *ends)


def _median(errors: Iterable[float | None]) -> float | None:
    known = [error for error in errors if error is not None]
    return float(f"{CENTIMETRES * np.median(known):.3g}") if known else None
