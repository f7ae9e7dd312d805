"""Limits of each guidance law: maximum slope, softest soil, furrows, rough ground, valve, and GNSS outages.

Each limit is found by a search with `limit` on the first straight, arc and return of the figure eight, at 1.2 m/s
without supervisor. A run fails if it does not complete, or if its cross-track error exceeds half a track width in more
than 5 % of the time. Each search is compared with the same drive without the condition.
"""

import tomllib
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from estimates import select
from matplotlib.figure import Figure
from sweeps import Blocks, Row, Study, variants

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.palette import BLUE, LIGHT_GREY, VERMILION
from agrobot_mj.extensions.search.limit.question import Question, check
from agrobot_mj.extensions.search.limit.search import find_limit
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.studies.engine.tasks import perform
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save

UNTIL = "xte_abs_p95 > 0.5 or outcome != completed"
SEEDS = 3
"""Maximum number of runs at an intermediate value of a search. At least twelve runs are made at each of the two
reported values."""
COMMON = {"supervisor.enabled": False, "path.turns": 2, "duration_s": 75.0}
FITTED = {
    "estimator.kind": "ekf_full",
    "estimator.terrain_compensation": True,
    **{f"sensors.{name}.enabled": True for name in ("gyro", "wheel_speed", "imu")},
}
"""Overrides that enable gyro, wheel-speed sensor, inertial unit, and a filter that uses these sensors."""
PAPER = "the paper's stack"
LAWS = variants("controllers")
DRIVEN = (
    *("network as printed", "P + network", "PI", "P + feed-forward", "PI + feed-forward"),
    *("pure pursuit", "Stanley", "LQR"),
)
SURVIVORS: dict[str, dict[str, Any]] = {
    PAPER: LAWS["network as printed"],
    **{law: {**FITTED, **LAWS[law]} for law in DRIVEN},
}
"""Overrides of each law. All laws except the paper's stack have the same sensors and filter."""


class Hardship(NamedTuple):
    """Difficult condition from survival.toml, with the varied key and its range."""

    name: str
    unit: str
    key: str
    start: float
    stop: float
    tolerance: float
    sound: dict[str, Any]
    set: dict[str, Any]
    offset: float = 0.0


HARDSHIPS = [Hardship(**each) for each in tomllib.loads(Path(__file__).with_suffix(".toml").read_text())["hardship"]]
JOBS = [(law, hardship) for hardship in HARDSHIPS for law in SURVIVORS]
"""Jobs of all searches: each law under each condition."""


def survival(study: Study) -> Blocks:
    """Return the table of limits by law, and draw the figure."""
    rows = study.done("survival", search, JOBS)
    if not rows:
        return {}
    with mpl.rc_context(STYLE):
        save(survival_figure(rows), study.images / "survival.png")
    return {"survival": survival_table(rows)}


def search(job: tuple[str, Hardship], seeds: int = SEEDS) -> Row:
    """Search for the limit of a law under a condition, and return a row with the result."""
    law, hard = job
    scenario = load_scenario("figure_eight", {**COMMON, **hard.set, **SURVIVORS[law]})
    question = Question(hard.key, hard.start, hard.stop, UNTIL, seeds=seeds, tolerance=hard.tolerance)
    condition = check(question, {law: scenario})
    drive, silent = lambda tasks: [perform(task).row for task in tasks], lambda tried: None
    found = find_limit(law, scenario, question, condition, drive, silent, hard.sound)
    sound = found.beside and {**found.beside._asdict(), "tried": [each.written for each in found.beside.tried]}
    tried = [each.written for each in found.tried]
    return {"law": law, "hardship": hard.name, "verdict": found.verdict, "tried": tried, "sound": sound}


def survived(row: Row) -> tuple[float | None, bool]:
    """Return the most severe value without failure (or None), and whether this value is the end of the range."""
    held = list(takewhile(lambda tried: tried["holds"], row["tried"]))
    return held[-1]["value"] if held else None, len(held) == len(row["tried"])


def survival_table(rows: Sequence[Row]) -> str:
    """Return a Markdown table with one row per law: error without any condition, and limit under each condition."""
    lines = []
    for law in SURVIVORS:
        cells = [_cells(select(rows, law=law, hardship=hard.name), hard) for hard in HARDSHIPS]
        lines.append((law, _without(select(rows, law=law)), *cells))
    heads = ("law", "no hardship: p95 [m]", *(f"{hard.name} [{hard.unit}]" for hard in HARDSHIPS))
    return markdown_table(heads, lines, 1)


def _without(rows: Sequence[Row]) -> str:
    """Return a table cell with the median error without any condition, and the number of failed runs."""
    runs = [row["sound"]["tried"][0] for row in rows if (row.get("sound") or {}).get("verdict") == "fixed"]
    if not runs:
        return "-"
    failed = f" ({runs[0]['failed']} of {runs[0]['runs']} fail)" if runs[0]["failed"] else ""
    error = runs[0]["medians"].get("xte_abs_p95")
    return ("-" if error is None else f"{error:.2f}") + failed


def _cells(found: Sequence[Row], hard: Hardship) -> str:
    if not found:
        return "-"
    sound = found[0].get("sound") or {}
    beside = f"; without: {_cell(sound, hard)}" if sound.get("verdict", "fixed") != "fixed" else ""
    return _cell(found[0], hard) + beside


def _cell(row: Row, hard: Hardship) -> str:
    """Return a table cell with the last value without failure and the first value with failure.

    A star marks values at which only some runs fail.
    """
    value, whole = survived(row)
    if value is None:
        return f"not {hard.start - hard.offset:g}"
    if whole:
        return f"all, to {value - hard.offset:g}"
    fails = next(tried for tried in row["tried"] if not tried["holds"])
    last = next(tried for tried in row["tried"] if tried["value"] == value)
    star = "" if last["failed"] == 0 and fails["failed"] == fails["runs"] else "\\*"
    again = "!" if row["verdict"] == "not_monotone" else ""
    return f"{value - hard.offset:.3g}, not {fails['value'] - hard.offset:.3g}{star}{again}"


def survival_figure(rows: Sequence[Row]) -> Figure:
    """Draw a panel per condition with the limit of each law. Grey bars are limits without the condition.

    An arrow marks a law without failure up to the end of the range, and a cross marks a law that fails at the start.
    """
    figure = Figure((2 * PANEL_WIDTH_IN, 4.2), layout="constrained")
    grid = figure.subplots(2, 3, sharey=True)
    for axes, hard in zip(grid.flat, HARDSHIPS, strict=True):
        zero = hard.offset + (0.0 if hard.stop > hard.start else hard.start)  # value at the milder end of the range
        begin = zero - hard.offset
        for place, law in enumerate(SURVIVORS):
            (row,) = select(rows, law=law, hardship=hard.name)
            sound, colour = row.get("sound") or {}, VERMILION if law == PAPER else BLUE
            if sound.get("verdict", "fixed") != "fixed":
                axes.barh(place, (survived(sound)[0] or zero) - zero, 0.8, begin, color=LIGHT_GREY)
            value, whole = survived(row)
            if value is None:
                axes.plot(begin, place, "x", color=colour, clip_on=False)
                continue
            axes.barh(place, value - zero, 0.5, begin, color=colour)
            if whole:
                axes.plot(hard.stop - hard.offset, place, ">", color=colour, clip_on=False)
        axes.set(title=f"{hard.name} [{hard.unit}]", xlim=(begin, hard.stop - hard.offset))
        axes.grid(axis="y", visible=False)
        axes.tick_params("y", length=0)
    grid[0, 0].set_yticks(range(len(SURVIVORS)), list(SURVIVORS))
    grid[0, 0].invert_yaxis()
    return figure
