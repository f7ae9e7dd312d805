"""The course of an ordinary run and of a failure: driven for a figure, the failure recorded beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from agrobot_mj.core.palette import BLUE, VERMILION
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.simulation.log import Log
from agrobot_mj.studies.closeness import Closeness
from agrobot_mj.studies.engine import Task
from agrobot_mj.studies.engine.resume import Resumed


@dataclass(frozen=True)
class MeasuredCourse:
    """Measures the course of a run for figures."""

    closeness: Closeness

    def __call__(self, log: Log) -> dict[str, Any]:
        """`course`: time [s], place [m] and closeness [-] of each tick."""
        columns = {name: log.column(name).tolist() for name in ("t", "x", "y", "x_ref", "y_ref")}
        return {"course": {**columns, "close": self.closeness(log).tolist()}}


def courses(tasks: Sequence[Task], closeness: Closeness, do: Resumed, kept: Mapping[str, str]) -> list[dict[str, Any]]:
    """The courses of an ordinary run and of a failure, if there is one, with the times of their branches [s].

    `kept` has the files of the failure's recording that stay, and their names in the folder.
    """
    names = [f"shown/{name}" for name in ("ordinary", "failure")][: len(tasks)]
    if not all((do.files.folder / name).is_file() for name in kept.values()):
        do.files.forget(names[-1])

    def keep(number: int, files: Mapping[str, bytes]) -> None:
        for name in kept.keys() & files.keys():
            do.files.write_bytes(Path(kept[name]), files[name])

    asked = [
        task._replace(number=k, keep="recordings" if k else "table", measure=MeasuredCourse(closeness))
        for k, task in enumerate(tasks)
    ]
    return [
        {**result.numbers["course"], "branches": [TICK_S * branch.tick for branch in task.branches or ()]}
        for task, result in zip(asked, do(asked, names, keep=keep), strict=True)
        if "course" in result.numbers
    ]


def draw_courses(axes: Axes, courses: Sequence[dict[str, Any]], labels: Sequence[str]) -> None:
    """Closeness over time, of an ordinary run and of failures; dots where the noise of one went its own way."""
    for course, label, colour in zip(courses, labels, ("0.6", VERMILION, BLUE), strict=False):
        t, close = course["t"], course["close"]
        axes.plot(t, close, color=colour, label=label)
        at = [min(int(when / (t[1] - t[0])), len(t)) - 1 for when in course.get("branches", ())]
        axes.plot([t[k] for k in at], [close[k] for k in at], "o", color=colour, markersize=2.5)
    axes.axhline(0.0, color="black", linewidth=0.6, linestyle="--")
    axes.set(xlabel="t [s]", ylabel="closeness to the condition [-]")
    axes.legend()
