"""The page about real machines: its blocks, and, where the logs are at hand, figures that their owner has printed."""

import os
from pathlib import Path

import pytest
from blocks import block
from riding_tractor import parts
from riding_tractor.closed_loop import recorded
from riding_tractor.logs import CALIBRATION, HELD_OUT, RIDING_TRACTOR, Repository, pursuit_log

PAGE = (Path(__file__).parents[4] / "docs" / "real_machine.md").read_text(encoding="utf-8")
DATA = os.environ.get("AGROBOT_MJ_LOGS", "")
needs_data = pytest.mark.skipif(
    not DATA, reason=f"set AGROBOT_MJ_LOGS to a clone of {RIDING_TRACTOR[0]} to compare with it"
)
OWNER = {"1E": 2.0, "1W": 2.6, "2E": 2.6, "2W": 3.5, "2E85": 2.4, "2W85": 2.4}
"""Mean distance from the line that the owner's notes print [cm]."""


def test_blind_figures_and_fits_have_tables_of_their_own():
    blind, fitted = block(PAGE, "held out"), block(PAGE, "fitted")
    runs = [run.name for run in HELD_OUT]
    assert all(f"| {run} |" in blind and f"| {run} |" not in fitted for run in runs)
    assert all(f"| {run.name} |" in fitted and f"| {run.name} |" not in blind for run in CALIBRATION)


def test_the_page_names_the_commit_and_every_part_writes_to_it():
    assert RIDING_TRACTOR[1][:8] in PAGE
    assert len(parts.PARTS) == 8
    for name in (
        "calibration",
        "relaxation",
        "closed loop",
        "gain",
        "slip",
        "turns",
        "gnss failures",
        "steering rates",
    ):
        assert block(PAGE, name).strip()


@needs_data
@pytest.mark.parametrize("run", [*CALIBRATION, *HELD_OUT], ids=lambda run: run.name)
def test_recorded_passes_are_as_their_owner_found_them(run):
    found = recorded(pursuit_log(Repository(Path(DATA), *RIDING_TRACTOR), run))
    assert found.mean == pytest.approx(OWNER[run.name], abs=0.7)
    assert found.left > 0
