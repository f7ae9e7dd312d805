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
    """Return the recording of a run of 25.4 s on the figure eight with the MuJoCo plant. The run ends between two
    observer calls."""
    path = tmp_path_factory.mktemp("recording") / "new" / "run.rrd"
    scenario = load_scenario("figure_eight", {"duration_s": 25.4})
    return Recorded(path, run(scenario, (Recording(path),)))


@pytest.fixture(scope="session")
def signals(eight, tmp_path_factory):
    """Return the columns of `signals.parquet` for the run of the fixture `eight`, with NaN for missing values."""
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
    """Return a copy of the log of a run of 21 s, which a test may change and replay."""
    return deepcopy(unchanged)
