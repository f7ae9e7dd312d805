"""Recording files that tests read."""

from functools import cached_property

import numpy as np
from rerun.chunk import RrdReader

from agrobot_mj.recording import Recording


class Recorded:
    """Recording file from which tests read entities, with rows in chronological order."""

    def __init__(self, path, log=None):
        self.path, self.log = path, log

    def identity(self):
        """Return the application id and the recording id."""
        (entry,) = RrdReader(str(self.path)).recordings()
        return entry.application_id, entry.recording_id

    @cached_property
    def chunks(self):
        return RrdReader(str(self.path)).stream().to_chunks()

    def entities(self):
        return {chunk.entity_path for chunk in self.chunks}

    def _batches(self, entity, static):
        return [
            chunk.to_record_batch()
            for chunk in self.chunks
            if chunk.entity_path == entity and chunk.is_static == static
        ]

    def column(self, entity, component):
        """Return the times [ns] and values of a component of an entity, in chronological order."""
        found = []
        for batch in self._batches(entity, False):
            times = batch.column("sim_time").cast("int64").to_pylist()
            found += zip(times, batch.column(component).to_pylist(), strict=True)
        times, values = zip(*sorted(found, key=lambda pair: pair[0]), strict=True)
        return np.array(times), list(values)

    def static(self, entity, component):
        """Return the value that was written last to a static component."""
        batches = [batch for batch in self._batches(entity, True) if component in batch.schema.names]
        last = max(batches, key=lambda batch: batch.column("rerun.controls.RowId")[-1].as_py())
        return last.column(component)[-1].as_py()


def replay(log, path, scenario=None):
    """Record a finished run again, in the same blocks as during the run, and return the recording."""
    rows, filled = log.rows, log.rows.filled
    recording = Recording(path)
    rows.filled = 0
    recording.start(scenario or log.scenario, log.scene, rows)
    for first in range(0, filled, 200):
        rows.filled = min(first + 200, filled)
        recording.advance(first)
    recording.finish(log)
    return Recorded(path, log)
