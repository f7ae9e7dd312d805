from copy import deepcopy

import pyarrow.parquet as pq
import pytest
import rerun as rr
from recorded import Recorded

from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording
from agrobot_mj.simulation.storage import write_log

rr.set_strict_mode(True)


@pytest.fixture(scope="session")
def eight(tmp_path_factory):
    """Return the start of the figure eight in MuJoCo with the network, ending between two observer calls."""
    path = tmp_path_factory.mktemp("recording") / "new" / "run.rrd"
    scenario = load_scenario("figure_eight", {"duration_s": 25.4})
    return Recorded(path, run(scenario, (Recording(path),)))


@pytest.fixture(scope="session")
def signals(eight, tmp_path_factory):
    """Return the columns of `signals.parquet` for this run, with NaN for missing values."""
    folder = tmp_path_factory.mktemp("signals")
    write_log(eight.log, folder)
    table = pq.read_table(folder / "signals.parquet")
    return {name: table[name].to_numpy() for name in table.column_names}


@pytest.fixture(scope="session")
def unchanged():
    """Return the log of a run of 21 s, which tests must not change."""
    return run(load_scenario("straight_line", {"duration_s": 21}))


@pytest.fixture
def short(unchanged):
    """Return a copy of a log that a test may change and replay."""
    return deepcopy(unchanged)
