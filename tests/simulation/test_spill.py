"""Long logs: only the last rows are in memory, and nobody sees a difference."""

import errno
import os
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from agrobot_mj import Simulation, load_scenario, run
from agrobot_mj.core import spill
from agrobot_mj.core.spill import Spilled
from agrobot_mj.metrics import metrics
from agrobot_mj.simulation import log as logs
from agrobot_mj.simulation.storage import write_log

SCENARIO = ("circle", {"plant.kind": "bicycle", "duration_s": 6.0})


@pytest.fixture
def small(monkeypatch):
    """A memory of 24 rows, of which 12 spill; a table in pieces of 50 rows."""
    monkeypatch.setattr(spill, "WINDOW", 24)
    monkeypatch.setattr(spill, "SPILL", 12)
    monkeypatch.setattr(logs, "PIECE", 50)


def filled(rows, shape, window=24):
    """An array and what it should hold."""
    store, truth = Spilled(rows, shape), np.random.default_rng(1).normal(size=(rows, *shape))
    for k, row in enumerate(truth):
        at = store.room(k)
        store.recent[at] = row
    return store, truth


KEYS = (
    *(np.s_[:], np.s_[3:5], np.s_[11:13], np.s_[0:90:7], np.s_[80:], np.s_[-5:], np.s_[5:5]),
    *(
        np.s_[:, 0],
        np.s_[13:90, 2],
        np.s_[85:, 1],
        np.s_[40, 1],
        np.s_[np.array([0, 50, 99])],
        np.s_[np.array([], dtype=int)],
    ),
    *(np.ix_([1, 30, 98], [0, 2]), np.ix_([90, 95], [1]), np.s_[0], np.s_[99]),
)


@pytest.mark.parametrize("key", KEYS, ids=str)
def test_rows_are_read_as_from_an_array(small, key):
    store, truth = filled(100, (3,))
    assert (store.first, len(store.recent)) == (84, 24)
    np.testing.assert_array_equal(store[key], truth[key])


@pytest.mark.parametrize(
    "key", [np.s_[:, 1, :2], np.s_[10:70:2], np.ix_([0, 60, 99], [1, 0]), np.s_[:, [1, 0], :2]], ids=str
)
def test_poses_are_read_as_from_an_array(small, key):
    store, truth = filled(100, (2, 7))
    np.testing.assert_array_equal(store[key], truth[key])


def test_rows_that_have_left_memory_are_not_written_to(small):
    store, truth = filled(100, (3,))
    with pytest.raises(IndexError, match="before 84"):
        store[50:] = 0.0
    store[90:, 1] = 5.0
    truth[90:, 1] = 5.0
    np.testing.assert_array_equal(store[:], truth)


def test_a_long_run_gives_the_same_log_and_files(small, tmp_path, monkeypatch):
    log = run(load_scenario(*SCENARIO))
    assert log.rows.values.first > 0
    monkeypatch.undo()
    plain = run(load_scenario(*SCENARIO))
    assert plain.rows.values.first == 0
    assert log.signals.equals(plain.signals, check_metadata=True)
    assert log.poses.tobytes() == plain.poses.tobytes()
    assert metrics(log) == metrics(plain)
    monkeypatch.setattr(logs, "PIECE", 50)
    write_log(log, tmp_path / "long")
    file = pq.ParquetFile(tmp_path / "long" / "signals.parquet")
    assert file.num_row_groups == 3
    assert file.read().equals(plain.signals, check_metadata=True)


def test_a_run_of_one_piece_is_written_as_a_table(tmp_path):
    """The bytes of ordinary files do not depend on the way they are written."""
    log = run(load_scenario(*SCENARIO))
    write_log(log, tmp_path)
    pq.write_table(log.signals, tmp_path / "whole.parquet", compression="zstd", use_dictionary=False)
    assert (tmp_path / "signals.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()


def test_states_before_and_after_what_has_left_memory_are_restored(small):
    sim = Simulation(*SCENARIO)
    sim.reset()
    states = {}
    while not sim.done:
        states[sim.rows.filled] = sim.save()
        sim.step()
    expected = sim.rows.values[:].tobytes(), sim.rows.poses[:].tobytes()
    for k in (119, 5, 60, 100, 12, 24, 23, 0):
        for again in (sim, Simulation(sim.scenario)):
            again.restore(states[k])
            assert again.rows.filled == k
            while not again.done:
                again.step()
            assert (again.rows.values[:].tobytes(), again.rows.poses[:].tobytes()) == expected


@pytest.fixture
def full_disk(monkeypatch, tmp_path):
    """A folder of temporary files that takes nothing."""

    def full(dir):
        return SimpleNamespace(seek=lambda at: None, write=failing, flush=lambda: None)

    def failing(data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(spill.tempfile, "TemporaryFile", full)
    monkeypatch.setattr(spill.tempfile, "gettempdir", lambda: str(tmp_path))
    spill._TOLD.clear()


def test_a_full_disk_costs_memory_and_no_results(small, full_disk, tmp_path, capsys):
    log = run(load_scenario(*SCENARIO))
    assert (log.rows.values.first, len(log.rows.values.recent)) == (0, 120)
    assert (
        capsys.readouterr().err
        == f"{tmp_path}: has no room for the log of a long run, which is kept in memory instead\n"
    )
    assert log.signals.equals(run(load_scenario(*SCENARIO)).signals)


def test_a_disk_that_is_full_for_a_while_loses_no_row(small, monkeypatch):
    store, truth = Spilled(200, (3,)), np.random.default_rng(2).normal(size=(200, 3))
    for k, row in enumerate(truth):
        if k == 40:
            store._file, kept = SimpleNamespace(seek=_no_room), store._file
        elif k == 90:
            store._file = kept
        at = store.room(k)
        store.recent[at] = row
    assert len(store.recent) > 24
    np.testing.assert_array_equal(store[:], truth)


def _no_room(*_, **__):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_and_a_full_memory_name_the_folder_and_the_remedy(small, full_disk, monkeypatch, tmp_path):
    monkeypatch.setattr(spill, "MOST_BYTES", 0)
    with pytest.raises(OSError, match=r"No space left on device.*TMPDIR") as told:
        run(load_scenario(*SCENARIO))
    assert (told.value.filename, told.value.errno) == (str(tmp_path), errno.ENOSPC)


def test_memory_does_not_grow_with_the_length_of_a_log():
    """An hour and ten hours take the same arrays."""
    sizes = [logs.Rows(ticks, 24, 13).values.recent.nbytes for ticks in (72_000, 720_000)]
    assert sizes[0] == sizes[1] < 12e6


def test_pieces_of_an_empty_log_are_an_empty_table():
    rows = logs.Rows(10, 0, 1)
    log = logs.Log(SimpleNamespace(), rows, SimpleNamespace(), "aborted", 0.0)
    (piece,) = log.pieces()
    assert piece.num_rows == 0
    assert isinstance(piece, pa.Table)
