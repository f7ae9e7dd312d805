"""Memory for metrics and files of a long log, which does not grow with its length."""

import subprocess
import sys
import tracemalloc
from contextlib import contextmanager
from importlib.util import find_spec

import numpy as np
import pytest

from agrobot_mj import Simulation
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.simulation.log import PIECE, Log
from agrobot_mj.simulation.storage import write_log

ROWS = 300_000  # Four hours of work


@pytest.fixture(scope="module")
def log():
    """Return a log of a given number of rows that repeats the rows of ten seconds."""
    sim = Simulation("circle", {"plant.kind": "bicycle", "duration_s": ROWS * TICK_S, "path.turns": 250})
    sim.reset()
    for _ in range(200):
        sim.step()
    rows = sim.rows
    values, poses = np.tile(rows.values[:200], (50, 1)), np.tile(rows.poses[:200], (50, 1, 1))
    while rows.filled < ROWS:
        values[:, rows.columns.index("t")] = (rows.filled + np.arange(len(values))) * TICK_S
        rows.extend(values[: ROWS - rows.filled], poses[: ROWS - rows.filled])
    return Log(sim.scenario, rows, sim.loop.plant.scene, "aborted", 1.0)


@contextmanager
def at_most(most):
    """Check that Python and NumPy allocations in the block never exceed a number of bytes."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()


def test_signal_table_of_a_long_run_is_written_block_by_block(log, tmp_path):
    with at_most(1.5 * 8 * PIECE * len(log.rows.columns)):
        write_log(log, tmp_path)


def test_body_positions_of_a_long_log_are_read_with_little_memory(log):
    with at_most(6 * 8 * ROWS):
        assert log.rows.poses[:ROWS, 0, :3].shape == (ROWS, 3)


@pytest.mark.skipif(find_spec("pandas") is None, reason="pandas is not installed")
def test_running_and_writing_a_log_does_not_import_pandas(tmp_path):
    """The extra for studies contains pandas, which pyarrow would import with 46 MB."""
    text = """
import sys
from pathlib import Path
from agrobot_mj import load_scenario, run
from agrobot_mj.simulation.storage import write_log
write_log(run(load_scenario("circle", {"plant.kind": "bicycle", "duration_s": 1.0})), Path(sys.argv[1]))
print("pandas" in sys.modules)
"""
    assert subprocess.check_output([sys.executable, "-c", text, str(tmp_path)], text=True).strip() == "False"
