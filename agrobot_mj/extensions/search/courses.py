"""Trajectories of an ordinary and a failed run for the figures of a search, and the recording of the failed run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLACK, VERMILION
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.search.closeness import Closeness
from agrobot_mj.simulation.log import Log
from agrobot_mj.studies import Row, Task
from agrobot_mj.studies.engine.resume import RowFiles, Study
from agrobot_mj.studies.style import PANEL_WIDTH_IN

MOST_STRETCHED = 20.0  # Ratio of length to width of a plotted path above which the width is stretched [-]

COLUMNS = ("t", "x", "y", "x_ref", "y_ref")  # Signals that describe a trajectory


@dataclass(frozen=True)
class MeasuredCourse:
    """Function that returns the trajectory and the margin of a run for figures."""

    closeness: Closeness

    def __call__(self, log: Log) -> dict[str, Any]:
        """Return the columns `course.*` with one value per tick: time [s], position and reference position [m], and
        margin [-]."""
        columns = {f"course.{name}": log.column(name).tolist() for name in COLUMNS}
        return {**columns, "course.close": self.closeness(log).tolist()}


def courses(tasks: Sequence[Task], closeness: Closeness, do: Study, kept: Mapping[str, str]) -> list[dict[str, Any]]:
    """Simulate an ordinary run and, if available, a failed run. Return their trajectories and branch times [s]."""
    ordinary, *failure = [task._replace(measure=MeasuredCourse(closeness)) for task in tasks]
    failure = [task._replace(keep="recordings") for task in failure]
    recorded = Study(_Renamed(do.rows.folder, kept), do.perform)
    rows = [*do([ordinary]), *recorded(failure)]
    return [
        {name: row[f"course.{name}"] for name in (*COLUMNS, "close")}
        | {"branches": [TICK_S * branch.tick for branch in task.branches or ()]}
        for task, row in zip(tasks, rows, strict=True)
        if "course.close" in row
    ]


class _Renamed(RowFiles):
    """Row files of runs, and selected files of the runs in the results folder under new names."""

    def __init__(self, folder: Path, kept: Mapping[str, str]) -> None:
        super().__init__(folder)
        self.kept = kept

    def has(self, task: Task, row: Row) -> bool:
        """Return whether all renamed files exist in the results folder."""
        return all((self.folder / name).is_file() for name in self.kept.values())

    def put(self, task: Task, contents: Mapping[str, bytes]) -> None:
        """Write the selected files of a run under their new names."""
        for name in self.kept.keys() & contents.keys():
            self.write_bytes(Path(self.kept[name]), contents[name])


def courses_figure(courses: Sequence[dict[str, Any]], labels: Sequence[str]) -> tuple[Figure, Axes, Axes]:
    """Draw the trajectories and margins of an ordinary and a failed run. Return the figure, its empty panel for further
    curves, and its panel with the margins."""
    drawn = Figure((2 * PANEL_WIDTH_IN, 4.2), layout="constrained")
    panels = drawn.subplot_mosaic([["", "close"], ["above", "above"]], height_ratios=(3, 2))
    close, above = panels["close"], panels["above"]
    for course, label, colour in zip(courses, labels, ("0.6", VERMILION), strict=False):
        met = [course["close"].index(value) for value in course["close"] if value > 0.0][:1]
        marks = [(min(round(when / TICK_S), len(course["t"])) - 1, "o", 2.5) for when in course["branches"]]
        for axes, x, y in ((close, "t", "close"), (above, "x", "y")):
            axes.plot(course[x], course[y], color=colour, label=label)
            for k, marker, size in (*marks, *((k, "x", 5.0) for k in met)):
                axes.plot(course[x][k], course[y][k], marker, color=colour, markersize=size)
    if courses:
        above.plot(courses[0]["x_ref"], courses[0]["y_ref"], "--", color=BLACK, linewidth=0.6, label="reference")
        close.legend()
        above.legend()
    close.axhline(0.0, color=BLACK, linewidth=0.6, linestyle="--")
    close.set(xlabel="t [s]", ylabel="margin to failure [-]")
    above.set(xlabel="x [m]", ylabel="y [m]")
    if above.dataLim.height > above.dataLim.width / MOST_STRETCHED:
        above.set_aspect("equal", "datalim")
    return drawn, panels[""], close
