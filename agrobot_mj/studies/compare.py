"""A comparison: its runs, their folders and rows, and the paper's figures."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from agrobot_mj.metrics.success import without_errors
from agrobot_mj.recording import Recording, write_comparison
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.ownership import reserve
from agrobot_mj.simulation.run import run
from agrobot_mj.simulation.storage import exclusive, files_of_run, write_json, write_log
from agrobot_mj.studies.compare_plan import Case
from agrobot_mj.studies.pieces import pieces
from agrobot_mj.studies.pool import cores, spread

MOST_DRAWN = 24
"""Laws that figures and the common recording show; more could not be told apart."""


def compare(
    todo: Sequence[Case],
    folder: Path,
    rrd: bool = True,
    jobs: int | None = None,
    done: Callable[[Case], None] = lambda case: None,
) -> list[dict[str, Any]]:
    """Run all cases, some at a time, and write everything under `folder`; returns the rows of comparison.json.

    Tracking errors of a run that failed are None there; its own metrics.json has what was measured. Figures and the
    common recording are of the first seed and the first `MOST_DRAWN` laws.
    """
    shown = drawn(todo)
    wanted = frozenset(case.folder for case in shown)
    metrics: dict[str, dict[str, Any]] = {}
    logs: dict[str, Log] = {}
    reserve(folder, dict.fromkeys(case.folder for case in todo))
    work = partial(_run_case, folder=folder, rrd=rrd, wanted=wanted)
    for case, (found, log) in spread(work, todo, min(len(todo), jobs or cores())):
        metrics[case.folder] = found
        if log is not None:
            logs[case.folder] = log
        done(case)
    covered = pieces(case.scenario for case in todo)
    rows = [_row(case, piece, metrics[case.folder]) for case, piece in zip(todo, covered, strict=True)]
    write_json(folder / "comparison.json", rows)
    if rrd:
        write_comparison([(f"{case.plant}-{case.law}", logs[case.folder]) for case in shown], folder / "comparison.rrd")
    from agrobot_mj.studies.report import write_figures  # here, since workers import this module and draw nothing

    failed = {row["folder"] for row in rows if not row["expected"]}
    write_figures([(case.plant, case.law, logs[case.folder], case.folder in failed) for case in shown], folder)
    return rows


def files_of_comparison(todo: Sequence[Case]) -> tuple[str, ...]:
    """Names of all files and folders that a comparison may write into its folder."""
    from agrobot_mj.studies.report import FIGURES

    drawings = (f"{draw.__name__}.png" for draw in FIGURES)
    return "comparison.json", "comparison.rrd", *drawings, *dict.fromkeys(case.folder for case in todo)


def drawn(todo: Sequence[Case]) -> list[Case]:
    """The cases that figures show."""
    laws = list(dict.fromkeys(case.law for case in todo))[:MOST_DRAWN]
    return [case for case in todo if case.seed == todo[0].seed and case.law in laws]


def _run_case(case: Case, folder: Path, rrd: bool, wanted: frozenset[str]) -> tuple[dict[str, Any], Log | None]:
    """Metrics of a case, and its log if it is wanted: thousands of logs would not fit into memory."""
    place = folder / case.folder
    with exclusive(place, files_of_run(case.scenario)):
        log = run(case.scenario, (Recording(place / "run.rrd"),) if rrd else ())
        write_log(log, place, recorded=rrd)
    return log.metrics, log if case.folder in wanted else None


def _row(case: Case, piece: int, metrics: dict[str, Any]) -> dict[str, Any]:
    law = {"controller": case.controller, "guidance": case.scenario.guidance.kind, "variant": case.variant}
    about = {"plant": case.plant, **law, "seed": case.seed, "folder": case.folder, "piece": piece}
    expected = case.scenario.expects(metrics["outcome"], metrics.get("stop_reason", ""))
    return without_errors({**about, "outcome": metrics["outcome"], "expected": expected, **metrics})
