"""`report.html` for a folder of results, and figures as files for print."""

from collections.abc import Callable
from pathlib import Path

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.simulation.ownership import check_output
from agrobot_mj.studies.pages.document import Document
from agrobot_mj.studies.pages.drive import comparison_page, run_page
from agrobot_mj.studies.pages.print import sweep_figures
from agrobot_mj.studies.pages.sweep import sweep_page
from agrobot_mj.studies.pages.verdicts import limit_page, validation_page
from agrobot_mj.studies.results_io import reporting_damage

PAGES: dict[str, Callable[[Path], Document]] = {
    "sweep.parquet": sweep_page,
    "comparison.json": comparison_page,
    "limit.json": limit_page,
    "validation.json": validation_page,
    "signals.parquet": run_page,
}
"""Function that makes the page, by the file that identifies a folder's content."""

FILES = ("report.html", "ranking.png", "curves.png")
"""Files of a report."""


def write_report(folder: Path) -> list[Path]:
    """Write the report of a folder of results into it; returns the files. Raises `ScenarioError`."""
    if not folder.is_dir():
        raise ScenarioError(f"{folder}: no such folder")
    found = next((name for name in PAGES if (folder / name).is_file()), None)
    if found is None:
        raise ScenarioError(f"{folder}: holds no results; name a folder of run, compare, sweep, limit or validate")
    check_output(folder, FILES)
    with reporting_damage(folder / found, "reported"):
        page = PAGES[found](folder)
        printed = sweep_figures(folder) if found == "sweep.parquet" else []
    return [page.write(folder / "report.html"), *printed]
