"""Recording of a run in blocks during the run. The file remains readable if the process is killed.

The blocks are sent in a separate thread, because the compiled part of a run does not need Python's global lock.
"""

import errno
import uuid
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from copy import copy
from pathlib import Path

import numpy as np
import rerun as rr

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.plants.scene import Scene
from agrobot_mj.recording.blueprint import Shown, blueprint
from agrobot_mj.recording.info import describe, exception_text, running, summary, tell
from agrobot_mj.recording.plots.axes import Frame
from agrobot_mj.recording.plots.catalogue import reported_plots
from agrobot_mj.recording.plots.network import Firing, network_columns, network_plots
from agrobot_mj.recording.plots.signals import Signals
from agrobot_mj.recording.plots.states import LANES, States
from agrobot_mj.recording.transport.sink import Sink, is_enabled
from agrobot_mj.recording.transport.timeline import APPLICATION, nanoseconds
from agrobot_mj.recording.world.motion import BodyMotion
from agrobot_mj.recording.world.names import size_in_view
from agrobot_mj.recording.world.scene import camera_target, reference_line, send_scene
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log, Rows
from agrobot_mj.simulation.storage import RECORDING, clear

SPARE_BYTES = 1_000_000
"""Free disk space kept for other files of the run [bytes], in addition to the size of all signals."""


class Recording:
    """Observer that records a run to a file, to a live viewer, or to both."""

    def __init__(self, path: Path | None, live: bool = False) -> None:
        self.path, self.live = path, live

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        """Open the recording and send its static content. Raises OSError if the file cannot be written."""
        self.scenario, self._filled, self.rows = scenario, rows, copy(rows)  # the copy is constant while it is sent
        self._thread = ThreadPoolExecutor(1, "recording")
        self._sending = self._thread.submit(self._start, scenario, scene, self.rows)
        try:
            self._sending.result()
        except BaseException:
            self._thread.shutdown(wait=False)
            raise

    def _start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        ground = scenario.terrain.ground()
        if self.path is not None and self.path.name == RECORDING:
            clear(self.path.parent)  # older results would not match the new recording
        self.stream = rr.RecordingStream(APPLICATION, recording_id=f"{scenario.name}-{scenario.hash8}-{uuid.uuid4()}")
        self.recording = is_enabled(self.stream, self.path)
        if not self.recording:
            return
        self.sink = Sink(self.stream, self.path, self.live, rows.values.nbytes + SPARE_BYTES)
        describe(self.stream, f"{scenario.name} ({scenario.plant.kind}, {scenario.law})", scenario)
        tell(self.stream, running(scenario))
        self.reference = reference_line(scenario, ground)
        send_scene(self.stream, scene, ground, self.reference)
        self.motion = BodyMotion(rows, scene, ground, scenario, self.reference)
        elsewhere = (*network_columns(rows.columns), *(lane.column for lane in LANES))
        more = (*network_plots(rows.columns), *reported_plots(rows.table, elsewhere))
        without = ("tau_n",) if scenario.controller.kind == "pd" else ()  # always zero without a network
        self.signals, self.firing = Signals(rows, more, without), Firing(rows)
        self.states = States(rows, scenario.fault)
        self.recording = self.sink.flush()
        if not self.recording:
            raise OSError(errno.ENOSPC, "there is no space for a recording", str(self.path))

    def advance(self, first: int) -> None:
        """Send the log rows from `first` to `rows.filled` in a separate thread, after the previous rows have been
        sent."""
        self.wait()
        if self.rows.filled > first and self.recording:
            self._sending = self._thread.submit(self._send_rows, first)

    def wait(self) -> None:
        """Wait until the previous rows have been sent, and raise the error if sending them has failed."""
        self._sending.result()
        self.rows.filled = self._filled.filled

    def _send_rows(self, first: int) -> None:
        times = nanoseconds(self.rows.column("t", first))
        for part in (self.motion, self.signals, self.firing, self.states):
            part.send(self.stream, times, first)
        if first == 0:
            self._lay_out(self.scenario.ticks * TICK_S)
        self.recording = self.sink.flush()

    def finish(self, log: Log) -> None:
        """Write the outcome and metrics, and close the recording."""
        self.wait()
        if self.recording:
            self._thread.submit(self._finish, log).result()
        self._thread.shutdown()

    def _finish(self, log: Log) -> None:
        numbers = {name: value for name, value in log.metrics.items() if isinstance(value, int | float | str)}
        self.stream.send_property("metrics", rr.AnyValues(drop_untyped_nones=True, **numbers))
        tell(self.stream, summary(log))
        self.motion.finish(self.stream, log)
        self.states.finish(self.stream, log.outcome)
        if self.rows.filled:
            self._lay_out(self.rows.filled * TICK_S, log.outcome)
        self.sink.close()

    def fail(self, error: BaseException) -> None:
        """Write the exception that ended the run, and close the recording.

        The file is deleted if the run is interrupted before its first row.
        """
        with suppress(Exception):  # `error` may be an error of a previous block
            self.wait()
        self._thread.shutdown()
        if not self.recording:
            return
        tell(self.stream, exception_text(self.scenario, error, self.rows.filled * TICK_S))
        self.sink.close()
        if self.path is not None and isinstance(error, KeyboardInterrupt) and not self.rows.filled:
            self.path.unlink(missing_ok=True)

    def _lay_out(self, end_s: float, outcome: str = "") -> None:
        """Send a viewer layout for the content up to `end_s` [s]. This layout replaces the previous layout."""
        places = np.concatenate([self.rows.poses[: self.motion.last + 1, 0, :3], self.reference])
        plots, frames = self.signals.shown, dict[str, Frame]()
        if outcome:  # constant plots are identified at the end of the run
            frames = self.signals.finish(self.stream)
            plots = [plot for plot in plots if plot.path in frames]
        size, seen = self.scenario.tractor.size, f"world/bodies/{camera_target(self.motion.scene)}"
        size = size_in_view(size, self.rows.poses[0, :, :2])
        shown = Shown(plots, self.firing.maps, self.states.count, frames, outcome, size, seen)
        self.stream.send_blueprint(blueprint(shown, places, self.rows.column("yaw")[0], end_s))
