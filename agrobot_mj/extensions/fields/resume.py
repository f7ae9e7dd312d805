"""Continuation of interrupted field work from a state stored in the user's cache folder.

The state is stored at an interruption and every few minutes, in a file named by the identity of the run. The folder
contains the states of the last `KEPT` runs. It must belong to the user, because loading a state can execute code.
"""

import pickle
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

from platformdirs import user_cache_path

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import SavedRows
from agrobot_mj.simulation.results import atomic
from agrobot_mj.simulation.snapshot import Snapshot
from agrobot_mj.simulation.stepping import Simulation

EVERY_S = 300.0  # Wall-clock time between two stored states [s]
KEPT = 2  # Number of runs whose states are kept in the folder


class Interrupted:
    """Stored state of an interrupted simulation, for its continuation."""

    def __init__(self, scenario: Scenario, stopped: Callable[[], bool]) -> None:
        self.scenario, self.stopped = scenario, stopped
        self.folder = user_cache_path("agrobot_mj") / "field_runs"
        self.file = self.folder / f"{scenario.identity}.pickle"
        self.state: Snapshot | None = None

    def load(self) -> None:
        """Load the stored state. Raise `ScenarioError` if no state is stored, or if its file is damaged."""
        try:
            state = pickle.loads(self.file.read_bytes())
            self.state = state._replace(scenario=self.scenario)
        except Exception:  # damaged files raise errors of many types
            raise ScenarioError(
                "--resume: there is no interrupted drive with these options; omit --resume to start a new drive"
            ) from None

    def store(self, sim: Simulation) -> None:
        """Store the state of a simulation with all log rows. A write error, such as a full disk, is ignored."""
        rows = sim.rows
        saved = SavedRows(rows.filled, (), (rows.values[: rows.filled], rows.poses[: rows.filled]))
        state = sim.save(saved)
        with suppress(OSError):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with atomic(self.file) as path, path.open("wb") as file:
                pickle.dump(state, file, protocol=pickle.HIGHEST_PROTOCOL)
            for old in sorted(self.folder.glob("*.pickle"), key=lambda each: -each.stat().st_mtime)[KEPT:]:
                old.unlink(missing_ok=True)
        rows.release()

    def ticks(self, sim: Simulation) -> Iterator[None]:
        """Simulate to the end, starting from the loaded state or from the beginning. Store the state periodically and
        when the run is interrupted."""
        if self.state is None:
            sim.reset()
        else:
            sim.restore(self.state)
            self.state = None
        due = time.monotonic() + EVERY_S
        while not sim.done:
            sim.advance()
            yield  # signals take effect here
            stopped = self.stopped()
            if not sim.done and (stopped or time.monotonic() > due):
                self.store(sim)
                due = time.monotonic() + EVERY_S
            if stopped:
                sim.abort()
        if sim.outcome != "aborted":
            self.file.unlink(missing_ok=True)
