"""Storage of long logs in a file, with unchanged results."""

import errno
import os
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from agrobot_mj import Simulation, load_scenario, run
from agrobot_mj.core import long_array
from agrobot_mj.core.long_array import LongArray
from agrobot_mj.metrics import metrics
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.simulation import log as logs
from agrobot_mj.simulation.storage import write_log

SCENARIO = ("circle", {"plant.kind": "bicycle", "duration_s": 6.0})


@pytest.fixture
def small(monkeypatch):
    """Set the block size of stored logs to 24 rows, and the block size of written tables to 50 rows."""
    monkeypatch.setattr(long_array, "PIECE", 24)
    monkeypatch.setattr(logs, "PIECE", 50)


def is_in_file(rows):
    return rows._values._map is not None


@pytest.mark.parametrize("by_column", [True, False])
def test_rows_of_a_log_are_unchanged_after_their_memory_is_released(small, by_column):
    store, truth = LongArray(100, (2, 7), by_column), np.random.default_rng(1).normal(size=(100, 2, 7))
    assert store.numbers.flags.c_contiguous != by_column
    for k, row in enumerate(truth):
        store.make_room(k + 1)
        store.numbers[k] = row
        store.release()
    np.testing.assert_array_equal(store.numbers, truth)


def test_path_samples_stored_in_a_file_are_unchanged(small, monkeypatch):
    path = load_scenario("circle").path
    stored = SampledRoute(path)
    assert stored.grows(30.0)
    assert stored._buffer._map is not None
    monkeypatch.undo()
    plain = SampledRoute(path)
    assert plain.grows(30.0)
    assert plain._buffer._map is None
    np.testing.assert_array_equal(stored.around(30.0), plain.around(30.0))


def test_run_stored_in_blocks_gives_the_same_log_and_files(small, tmp_path, monkeypatch):
    log = run(load_scenario(*SCENARIO))
    assert is_in_file(log.rows)
    monkeypatch.undo()
    plain = run(load_scenario(*SCENARIO))
    assert not is_in_file(plain.rows)
    assert log.signals.equals(plain.signals, check_metadata=True)
    assert log.poses.tobytes() == plain.poses.tobytes()
    assert metrics(log) == metrics(plain)
    monkeypatch.setattr(logs, "PIECE", 50)
    write_log(log, tmp_path / "long")
    file = pq.ParquetFile(tmp_path / "long" / "signals.parquet")
    assert file.num_row_groups == 3
    assert file.read().equals(plain.signals, check_metadata=True)


def test_table_written_as_one_block_equals_the_table_written_at_once(tmp_path):
    """Files with one block are bit-identical for both writing methods."""
    log = run(load_scenario(*SCENARIO))
    write_log(log, tmp_path)
    pq.write_table(log.signals, tmp_path / "whole.parquet", compression="zstd", use_dictionary=False)
    assert (tmp_path / "signals.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()


def test_saved_states_of_a_run_stored_in_blocks_can_be_restored(small):
    sim = Simulation(*SCENARIO)
    sim.reset()
    states = {}
    while not sim.done:
        states[sim.rows.filled] = sim.save()
        sim.step()
    expected = sim.rows.values.tobytes(), sim.rows.poses.tobytes()
    for k in (119, 5, 60, 100, 12, 24, 23, 0):
        for again in (sim, Simulation(sim.scenario)):
            again.restore(states[k])
            assert again.rows.filled == k
            while not again.done:
                again.step()
            assert (again.rows.values.tobytes(), again.rows.poses.tobytes()) == expected


@pytest.fixture
def full_disk(monkeypatch, tmp_path):
    """Limit the folder of temporary files to 48 rows per column."""

    def fallocate(file, offset, length):
        rows = 120
        if offset % (8 * rows) + length > 8 * 48:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(long_array.os, "posix_fallocate", fallocate, raising=False)
    monkeypatch.setattr(long_array.tempfile, "gettempdir", lambda: str(tmp_path))
    long_array._TOLD.clear()


def test_log_is_kept_in_memory_without_loss_when_the_disk_is_full(small, full_disk, tmp_path, monkeypatch, capsys):
    log = run(load_scenario(*SCENARIO))
    assert not is_in_file(log.rows)
    said = f"{tmp_path}: there is no space for the log of a long run; the log is kept in memory\n"
    assert capsys.readouterr().err == said
    monkeypatch.undo()
    assert log.signals.equals(run(load_scenario(*SCENARIO)).signals)


def test_full_log_is_kept_in_memory_if_its_file_exceeds_a_size_limit(small, tmp_path, monkeypatch, capsys):
    def refused():
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))

    monkeypatch.setattr(long_array.tempfile, "TemporaryFile", refused)
    monkeypatch.setattr(long_array, "_TOLD", set())
    log = run(load_scenario(*SCENARIO))
    assert not is_in_file(log.rows)
    assert capsys.readouterr().err.endswith("is kept in memory\n")
    monkeypatch.undo()
    assert log.signals.equals(run(load_scenario(*SCENARIO)).signals)


def test_error_for_full_disk_or_memory_names_the_folder_and_a_remedy(small, full_disk, monkeypatch, tmp_path):
    monkeypatch.setattr(long_array, "MOST_BYTES", 0)
    with pytest.raises(OSError, match=r"No space left on device.*TMPDIR") as told:
        run(load_scenario(*SCENARIO))
    assert (told.value.filename, told.value.errno) == (str(tmp_path), errno.ENOSPC)


def test_long_log_is_stored_in_a_file_instead_of_memory():
    """The log of a day needs only address space."""
    rows = logs.Rows(1_728_000, 24, 13)
    assert is_in_file(rows)
    assert rows.values.shape[0] == 1_728_000


def test_an_empty_log_gives_an_empty_table():
    rows = logs.Rows(10, 0, 1)
    log = logs.Log(SimpleNamespace(), rows, SimpleNamespace(), "aborted", 0.0)
    (piece,) = log.pieces()
    assert piece.num_rows == 0
    assert isinstance(piece, pa.Table)
