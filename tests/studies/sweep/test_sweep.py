"""Sweeps of short runs: the table is the same for any way of execution and after interruptions."""

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import processes
import pyarrow.parquet as pq
import pytest
from row_files import row_file
from told import without_progress
from typer.main import get_command

from agrobot_mj import cli, load_scenario, run
from agrobot_mj.simulation.results import MARK
from agrobot_mj.studies.engine import resume, tasks, workers
from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.runner import SweepOptions
from agrobot_mj.studies.sweep.runner import sweep as run_sweep
from agrobot_mj.studies.sweep.schema import read_sweep
from agrobot_mj.studies.sweep.store import Store

TEXT = """
base = "figure_eight"
seeds = 2
paired = true
[set]
duration_s = 1
"plant.kind" = "bicycle"
[axes]
"path.speed_m_s" = [0.8, 1.2]
"fault" = [[], [{ kind = "gnss_loss", start_s = 0, end_s = 1 }]]
[draws]
"steering.valve.dead_band_v" = { uniform = [0.2, 0.8] }
[[variant]]
name = "paper"
[[variant]]
name = "stanley"
set = { "guidance.kind" = "stanley" }
"""
TOTAL = 16
ROOT = Path(__file__).parents[3]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(TEXT, encoding="utf-8")
    return path


@pytest.fixture
def call(call):
    """Return a function that runs `agrobot-mj sweep` in an empty folder: exit status, stdout and stderr."""
    return partial(call, "sweep")


def table(folder):
    """Return the table of a sweep folder without wall times."""
    return pq.read_table(folder / "sweep.parquet").drop_columns("wall_s")


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    """Return the folder of a sweep that was simulated in this process."""
    folder = tmp_path_factory.mktemp("serial")
    (folder / "mine.toml").write_text(TEXT, encoding="utf-8")
    run_sweep(folder / "mine.toml", folder / "out", SweepOptions(jobs=1, quiet=True))
    return folder / "out"


def test_row_contains_the_parameters_and_metrics_of_its_run(serial):
    rows = pq.read_table(serial / "sweep.parquet").to_pylist()
    assert [row["run"] for row in rows] == list(range(TOTAL))
    row = rows[-1]
    assert (row["variant"], row["seed"], row["path.speed_m_s"]) == ("stanley", 2, 1.2)
    assert json.loads(row["fault"])[0]["kind"] == "gnss_loss"
    keys = ("path.speed_m_s", "steering.valve.dead_band_v", "seed")
    overrides = {
        "duration_s": 1,
        "plant.kind": "bicycle",
        "guidance.kind": "stanley",
        "fault": json.loads(row["fault"]),
    }
    metrics = run(load_scenario("figure_eight", {**overrides, **{key: row[key] for key in keys}})).metrics
    for name in ("outcome", "lateral_rms", "xte_abs_p95", "position_nees", "steer_saturated_fraction"):
        assert row[name] == metrics[name]
    assert row["wall_s"] > 0
    assert list(row)[-3:] == ["wall_s", "identity", "version"]
    assert row["identity"] == metrics["identity"]
    assert "real_time_factor" not in row


@pytest.mark.parametrize("apart", [True, False])
def test_two_merged_shards_give_the_same_table_as_one_sweep(serial, file, tmp_path, call, apart):
    folders = [tmp_path / "a", tmp_path / ("b" if apart else "a")]
    for k, folder in enumerate(folders, 1):
        status, _, _ = call(file, "--shard", f"{k}/2", "--jobs", 1, "--out", folder)
        assert status == 0
    if apart:
        status, out, err = call("--merge", folders[0], "--out", tmp_path / "all")
        assert (status, out.split(";")[0]) == (1, "8 of 16 runs")
        assert "8 of 16 runs are missing" in err
    status, out, err = call("--merge", *dict.fromkeys(folders), "--out", tmp_path / "all")
    assert (status, err) == (0, "")
    assert table(tmp_path / "all").equals(table(serial))
    if not apart:
        assert table(folders[0]).equals(table(serial))


def test_sweep_of_the_resolved_sweep_file_gives_the_same_table(serial, tmp_path):
    run_sweep(serial / "sweep.toml", tmp_path / "again", SweepOptions(jobs=1, quiet=True))
    assert table(tmp_path / "again").equals(table(serial))
    assert run_sweep(serial / "sweep.toml", serial, SweepOptions(jobs=1, quiet=True)).new == 0


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_sweep_executed_with_dask_gives_the_same_table(serial, file, tmp_path, workers):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install 'agrobot-mj[cluster]'")
    options = {
        "n_workers": workers,
        "threads_per_worker": 1,
        "processes": True,
        "dashboard_address": None,
        "host": "127.0.0.1",
    }
    with distributed.LocalCluster(**options) as cluster:
        found = run_sweep(file, tmp_path / "out", SweepOptions(scheduler=cluster.scheduler_address, quiet=True))
    assert (found.new, found.errors) == (TOTAL, 0)
    assert table(tmp_path / "out").equals(table(serial))


def test_unreachable_dask_scheduler_is_reported_without_loss_of_results(file, tmp_path, call, monkeypatch):
    monkeypatch.setattr(workers, "PATIENCE_S", 2)
    pytest.importorskip("distributed", reason="Dask is not installed: pip install 'agrobot-mj[cluster]'")
    call(file, "--shard", "1/4", "--jobs", 1, "--out", tmp_path / "out")
    status, out, err = call(file, "--scheduler", "tcp://127.0.0.1:9", "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert err.startswith("--scheduler tcp://127.0.0.1:9: the scheduler cannot be reached: ")
    assert len(list((tmp_path / "out" / "rows").rglob("*.json"))) == TOTAL // 4


def test_lost_dask_scheduler_is_reported_and_finished_runs_are_kept(file, tmp_path, call, monkeypatch):
    """The executor of Dask cancels running tasks when the scheduler is lost."""

    class Lost:
        def submit(self, function, task):
            future = Future()
            if task.number < 3:
                future.set_result(function(task))
            else:
                future.cancel()
                future.set_running_or_notify_cancel()
            return future

    monkeypatch.setattr(
        workers, "_client", lambda address: nullcontext(SimpleNamespace(get_executor=lambda pure: Lost()))
    )
    monkeypatch.setattr(workers, "_workers", lambda client, address: 1)
    status, out, err = call(file, "--scheduler", "tcp://here:1", "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert err.startswith("--scheduler tcp://here:1: the connection was lost; finished runs are kept")
    assert 0 < table(tmp_path / "out").num_rows <= 3


def test_error_for_missing_dask_names_the_extra(file, tmp_path, call, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    status, _, err = call(file, "--scheduler", "tcp://127.0.0.1:9")
    assert (status, err) == (2, '--scheduler needs distributed; pip install "agrobot-mj[cluster]"\n')


def test_an_interrupted_sweep_resumes(serial, file, tmp_path, monkeypatch):
    driven, real = [], tasks._run_task

    def stops_after(most):
        def drive(task, scenario):
            if len(driven) == most:
                raise KeyboardInterrupt
            driven.append(task.number)
            return real(task, scenario)

        return drive

    options, folder = SweepOptions(jobs=1, quiet=True), tmp_path / "out"
    for most in (5, 11):
        monkeypatch.setattr(tasks, "_run_task", stops_after(most))
        with pytest.raises(KeyboardInterrupt):
            run_sweep(file, folder, options)
        assert table(folder).num_rows == most
    row_file(folder, 2).write_text("{")  # as a loss of power may leave it
    monkeypatch.setattr(tasks, "_run_task", stops_after(None))
    found = run_sweep(file, folder, options)
    assert (found.before, found.new) == (10, 6)
    assert driven == [*range(11), 2, *range(11, TOTAL)]
    assert table(folder).equals(table(serial))


def test_changed_sweep_file_runs_only_new_combinations(serial, file, tmp_path, call, monkeypatch):
    folder = tmp_path / "out"
    assert call(file, "--jobs", 1, "--out", folder)[0] == 0
    file.write_text(TEXT.replace("1.2", "1.3"), encoding="utf-8")
    (folder / "notes.txt").write_text("mine")
    status, out, err = call(file, "--jobs", 1, "--out", folder)
    assert status == 0
    assert out.startswith("8 runs done, 8 already present")
    assert err == ""
    assert set(table(folder)["path.speed_m_s"].to_pylist()) == {0.8, 1.3}
    file.write_text(TEXT.replace("[0.8, 1.2]", "[0.8]"), encoding="utf-8")
    assert call(file, "--jobs", 1, "--out", folder)[1].startswith("0 runs done, 8 already present")
    assert table(folder).num_rows == 8
    assert call(file, "--jobs", 1, "--shard", "1/8", "--out", folder, "--fresh")[0] == 0
    assert (folder / "notes.txt").exists()


def test_sweep_runs_are_repeated_after_a_change_of_their_data_file(tmp_path, call):
    (tmp_path / "route.csv").write_text("x_m,y_m\n0,0\n10,0\n20,1\n")
    text = 'base = "figure_eight"\n[set]\nduration_s = 1\n"plant.kind" = "bicycle"\n'
    text += 'path = { kind = "waypoints", file = "route.csv" }\n'
    (tmp_path / "mine.toml").write_text(text)
    assert call("mine.toml", "--jobs", 1, "--out", "out")[0] == 0
    (tmp_path / "route.csv").write_text("x_m,y_m\n0,0\n10,0\n20,2\n")
    status, out, err = call("mine.toml", "--jobs", 1, "--out", "out")
    assert (status, out[:11]) == (0, "1 runs done")
    assert err.startswith("out: rows with another identity are run again: 1 with other files\n")


PLUGIN = '''
import os
from typing import Literal
from agrobot_mj.control import GuidanceLaw
from agrobot_mj.core.signals import Command


class Nasty(GuidanceLaw):
    """Drives straight on, raises, or ends its process."""

    kind: Literal["nasty"] = "nasty"
    way: Literal["fine", "raises", "dies"] = "fine"
    """What goes wrong."""

    def update(self, state, situation, dt):
        if self.way == "raises":
            raise RuntimeError("no such thing")
        if self.way == "dies":
            os._exit(3)
        return None, Command(steer=0.0, speed=1.0)
'''
NASTY = """
base = "straight_line"
[set]
duration_s = 1
"plant.kind" = "bicycle"
"guidance.kind" = "nasty"
expected_outcome = "completed"
[axes]
"guidance.way" = ["fine", "raises", "dies"]
"""


def test_failed_run_is_recorded_and_worker_processes_load_plugins(tmp_path):
    """The test needs worker processes, because one of the runs ends its process."""
    (tmp_path / "nasty.py").write_text(PLUGIN)
    (tmp_path / "mine.toml").write_text(NASTY)
    done = start(tmp_path, "mine.toml", "--plugin", "nasty.py", "--out", "out", "--jobs", "2")
    out, err = done.communicate()
    assert done.returncode == 0, err
    rows = pq.read_table(tmp_path / "out" / "sweep.parquet").to_pylist()
    assert [row["outcome"] for row in rows] == ["completed", "error", "error"]
    assert rows[0]["error"] is None
    assert rows[1]["error"] == "RuntimeError: no such thing (nasty.py, line 17)"
    assert "process died" in rows[2]["error"]
    assert "of which 2 did not end as expected" in out
    assert without_progress(err) == "2 runs raised an error; see the column `error` of sweep.parquet\n"
    (tmp_path / "nasty.py").write_text(PLUGIN + "# changed\n")
    again = processes.command(tmp_path, "sweep", "mine.toml", "--plugin", "nasty.py", "--out", "out", "--jobs", "1")
    assert again.returncode == 3, "the third run ends this process"
    assert again.stderr.startswith("out: rows with another identity are run again: 3 with other plugins\n")


def test_sweep_on_a_full_disk_is_reported_and_can_be_resumed(serial, file, tmp_path, call, monkeypatch):
    folder, real, room = tmp_path / "out", resume.write_json, [7]

    def write(path, content):
        if path.parent.parent.name == "rows":
            room[0] -= 1
            if room[0] < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(path, content)

    monkeypatch.setattr(resume, "write_json", write)
    status, out, err = call(file, "--jobs", 1, "--out", folder)
    text = "No space left on device; 7 finished runs are kept; free disk space and run the same command again"
    assert (status, out, err) == (1, "", f"{folder}: {text}\n")
    monkeypatch.undo()
    found = run_sweep(file, folder, SweepOptions(jobs=1, quiet=True))
    assert (found.before, found.new) == (7, 9)
    assert table(folder).equals(table(serial))


def test_sweep_keeps_the_run_files_selected_by_the_keep_key(tmp_path):
    text = 'base = "figure_eight"\nkeep = "KEEP"\n[set]\nduration_s = 1\n"plant.kind" = "bicycle"\n'
    text += '[[variant]]\nname = "a"\n[[variant]]\nname = "b"\nset = { expected_outcome = "stuck" }\n'
    files = {"signals.parquet", "metrics.json", "scenario.toml"}
    wanted = {
        "table": {},
        "signals": dict.fromkeys(("00000000", "00000001"), files),
        "failures": {"00000001": {*files, "run.rrd"}},
    }
    for keep, expected in wanted.items():
        (tmp_path / "mine.toml").write_text(text.replace("KEEP", keep))
        run_sweep(tmp_path / "mine.toml", tmp_path / keep, SweepOptions(jobs=1, quiet=True))
        there = tmp_path / keep / "runs"
        found = (
            {entry.name: {f.name for f in entry.iterdir()} - {MARK} for entry in there.iterdir()}
            if there.exists()
            else {}
        )
        assert found == expected


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b"])
def test_invalid_shard_option_of_a_sweep_is_reported(call, file, text):
    status, _, err = call(file, "--shard", text)
    assert (status, err) == (2, f"--shard {text}: must have the form PART/PARTS, from 1/4 to 4/4 for 4 parts\n")


def test_merging_unrelated_folders_is_rejected(serial, file, tmp_path, call):
    file.write_text(TEXT.replace("1.2", "1.3"), encoding="utf-8")
    call(file, "--shard", "1/8", "--jobs", 1, "--out", "other")
    status, _, err = call("--merge", serial, "other", "--out", "all")
    assert (status, err) == (
        2,
        "other: the folder belongs to another sweep: different sweep; "
        "run the same sweep in all folders, or omit this folder\n",
    )
    (tmp_path / "empty").mkdir()
    assert "has no sweep results" in call("--merge", serial, "empty", "--out", "all")[2]
    status, _, err = call("--merge", "mine.toml", "--out", "nowhere")
    assert (status, "none of the folders to merge exists; specify folders written with --shard" in err) == (2, True)
    assert not Path("nowhere").exists()


def test_merging_a_damaged_sweep_writes_nothing(serial, tmp_path, call):
    shutil.copytree(serial, "damaged")
    Path("damaged/base.toml").write_text("[[")
    status, _, err = call("--merge", "damaged", "--out", "all")
    assert (status, "sweep.toml: base: base.toml: not valid TOML" in err) == (2, True)
    assert not Path("all").exists()


def start(folder, *arguments):
    """Start `agrobot-mj sweep` in a separate process group."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "agrobot_mj", "sweep", *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True, **pipes)


def group(pid):
    """Return the running processes of a session."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            state, _, _, session = entry.joinpath("stat").read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(session) == pid and state not in "ZX":
            found.append(int(entry.name))
    return found


def killed_and_resumed(folder, text, kill_after_rows, serial_table):
    """Kill a sweep of two processes with SIGKILL at each of some numbers of rows, then complete the sweep."""
    (folder / "mine.toml").write_text(text)
    rows, before = folder / "out" / "rows", {}
    for number in kill_after_rows:
        sweep = start(folder, "mine.toml", "--out", "out", "--jobs", "2")
        deadline = time.monotonic() + 600
        while len(list(rows.rglob("*.json"))) < number and sweep.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        assert sweep.poll() is None, "it ended before it could be killed"
        assert len(group(sweep.pid)) >= 3
        os.kill(sweep.pid, signal.SIGKILL)
        sweep.wait()
        deadline = time.monotonic() + 300
        while group(sweep.pid) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert group(sweep.pid) == []
        sweep.communicate()
        there = {file: file.stat().st_mtime_ns for file in rows.rglob("[0-9a-f]*.json")}
        assert before.items() <= there.items(), "a finished run was done again"
        before = there
    out, err = processes.command(folder, "sweep", "mine.toml", "--out", "out", "--jobs", "1")[1:]
    assert without_progress(err) == ""
    done, kept = map(int, re.match(r"(\d+) runs done, (\d+) already present", out).groups())
    assert kept == len(before)
    assert done + kept == serial_table.num_rows
    assert before.items() <= {file: file.stat().st_mtime_ns for file in rows.rglob("[0-9a-f]*.json")}.items()
    assert table(folder / "out").equals(serial_table)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
def test_killed_sweep_leaves_no_process_and_can_be_completed(tmp_path):
    text = TEXT.replace("duration_s = 1\n", "duration_s = 20\n").replace("seeds = 2", "seeds = 1")
    run_sweep(_written(tmp_path / "serial.toml", text), tmp_path / "serial", SweepOptions(jobs=1, quiet=True))
    killed_and_resumed(tmp_path, text, (3,), table(tmp_path / "serial"))


@pytest.mark.slow
def test_sweep_of_two_hundred_runs_completes_after_two_kills(tmp_path):
    text = TEXT.replace("seeds = 2", "seeds = 25").replace("duration_s = 1\n", "duration_s = 2\n")
    run_sweep(_written(tmp_path / "serial.toml", text), tmp_path / "serial", SweepOptions(jobs=1, quiet=True))
    killed_and_resumed(tmp_path, text, (37, 121), table(tmp_path / "serial"))


def _written(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize("count", [400, pytest.param(2000, marks=pytest.mark.slow)])
def test_resumed_sweep_does_not_repeat_hundreds_of_finished_runs(tmp_path, call, count):
    short = '[set]\nduration_s = 1\n"plant.kind" = "bicycle"\n'
    text = f'base = "figure_eight"\n{short}[axes]\n"path.speed_m_s" = {{ from = 0.5, to = 1.5, count = {count} }}\n'
    (tmp_path / "mine.toml").write_text(text)
    row = {"outcome": "completed", "expected": True, "error": None, **{f"metric_{k}": k / 7 for k in range(25)}}
    call("mine.toml", "--shard", f"{count}/{count}", "--out", "out", "--jobs", 1)
    folder, plan = tmp_path / "out", SweepPlan(read_sweep("mine.toml"))
    store = Store(folder, plan)
    for number in range(count - 1):
        store.write_row(store.with_identity(plan.task(number)), row)
    found = run_sweep("mine.toml", folder, SweepOptions(quiet=True))
    assert (found.before, found.new) == (count, 0)
    assert pq.read_metadata(folder / "sweep.parquet").num_rows == count


def test_sweep_help_lists_every_option():
    names = {option for parameter in get_command(cli.app).commands["sweep"].params for option in parameter.opts}
    assert names >= {"--out", "--jobs", "--scheduler", "--shard", "--merge", "--fresh", "--max-runs", "--plugin"}


def test_sweep_folder_contains_no_absolute_paths_and_can_be_moved(tmp_path):
    """Data files are in the folder of the sweep file, so that results need no absolute paths."""
    private = tmp_path / "private"
    private.mkdir()
    for name, end in (("base", 1), ("other", 2)):
        (private / f"{name}.csv").write_text(f"x_m,y_m\n0,0\n10,0\n20,{end}\n")
    text = 'base = "figure_eight"\n[set]\nduration_s = 1\n"plant.kind" = "bicycle"\n'
    text += 'path = { kind = "waypoints", file = "base.csv" }\n[axes]\n"path.file" = ["base.csv", "other.csv"]\n'
    (private / "mine.toml").write_text(text)
    options = SweepOptions(jobs=1, quiet=True)
    run_sweep(private / "mine.toml", tmp_path / "out", options)
    for file in (tmp_path / "out").rglob("*.*"):
        assert b"private" not in file.read_bytes(), file
    assert pq.read_table(tmp_path / "out" / "sweep.parquet")["path.file"].to_pylist() == ["base.csv", "other.csv"]
    assert run_sweep(private / "mine.toml", tmp_path / "out", options).new == 0
    (tmp_path / "out").rename(tmp_path / "elsewhere")
    private.rename(tmp_path / "gone")
    moved = tmp_path / "elsewhere"
    assert run_sweep(moved / "sweep.toml", moved, options).new == 0
    run_sweep(moved / "sweep.toml", tmp_path / "again", options)
    assert table(tmp_path / "again").equals(table(moved))
    (moved / "other.csv").write_text("x_m,y_m\n0,0\n10,0\n20,3\n")
    assert run_sweep(moved / "sweep.toml", moved, options)[2:4] == (1, 1)


def test_sweep_of_incomplete_field_runs_writes_its_table(tmp_path):
    """Passes of these runs have no values, in records within a list."""
    file = tmp_path / "short.toml"
    file.write_text('base = "clothoid_swaths"\nseeds = 2\n[set]\nduration_s = 0.5\n"plant.kind" = "bicycle"\n')
    run_sweep(file, tmp_path / "out", SweepOptions(jobs=1, quiet=True))
    rows = pq.read_table(tmp_path / "out" / "sweep.parquet").to_pylist()
    assert [row["iso_12188_2_style.per_pass"][0]["xte_rms"] for row in rows] == [None, None]
