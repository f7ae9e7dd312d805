"""Results folder of a run: one writer and one set of files, in spite of full disks, signals and other processes."""

import errno
import json
import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from removed import is_there

from agrobot_mj import cli, load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.recording import Recording
from agrobot_mj.recording.transport import sink, snapshot
from agrobot_mj.scenario.overrides import relocate_files
from agrobot_mj.simulation import storage
from agrobot_mj.simulation.results import MARK, claim, results, write_json
from agrobot_mj.simulation.storage import write_log
from agrobot_mj.studies.engine import tasks

FILES = {"signals.parquet", "metrics.json", "scenario.toml"}
QUICK = ("--no-rrd", "--set", "duration_s=1", "--set", "plant.kind=bicycle", "--out", "out")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def call(call):
    """Return a function that runs a command line and returns its exit status and stderr output."""
    return lambda *arguments: call(*arguments)[::2]


def short(**overrides):
    return load_scenario("circle", {"duration_s": 1.0, "plant.kind": "bicycle", **overrides})


def names(folder="out"):
    return {path.name for path in Path(folder).iterdir()} - {MARK}


def ours(*files):
    """Create a folder `out` with files of an earlier command."""
    for name in files:
        Path("out", name).parent.mkdir(parents=True, exist_ok=True)
        Path("out", name).write_text("old")
    Path("out", MARK).write_text("")


# --- one writer ---------------------------------------------------------------------------------------------------


def test_results_folder_has_one_writer_at_a_time(call):
    with results(Path("out")):
        status, err = call("run", "circle", *QUICK)
    assert (status, names(".")) == (2, set())  # nor does an empty folder stay
    assert "--out out: another run is writing to this folder" in err
    assert call("run", "circle", *QUICK)[0] == 0


def test_half_written_files_of_a_killed_run_are_removed(call):
    claim(Path("out"), FILES)
    for name in (".signals.parquet.1a2b3c4d.part", ".metrics.json.k2x_9abc", ".mine.txt.12345678", "notes.txt"):
        Path("out", name).write_text("half")
    assert call("run", "circle", *QUICK)[0] == 0
    assert names() == FILES | {".mine.txt.12345678", "notes.txt"}


def test_half_written_files_of_a_killed_study_are_removed(call):
    left = [
        ".base.toml.e4c5c495.part",
        "rows/00000/.00000001.json.1a2b3c4d.part",
        "runs/00000001/.run.rrd.1a2b3c4d.part",
    ]
    mine = [".notes.part", "rows/.1a2b3c4d.part", "deep/er/.base.toml.e4c5c495.part"]
    claim(Path("out"), ("base.toml", "rows", "runs"))
    for name in (*left, *mine):
        Path("out", name).parent.mkdir(parents=True, exist_ok=True)
        Path("out", name).write_text("half")
    Path("mine.toml").write_text('base = "circle"\n[set]\nduration_s = 0.5\n"plant.kind" = "bicycle"\n')
    assert call("sweep", "mine.toml", "--jobs", "1", "--out", "out")[0] == 0
    assert [name for name in left if Path("out", name).exists()] == []
    assert [name for name in mine if not Path("out", name).exists()] == []


def test_second_run_that_is_killed_leaves_no_signals_of_the_first_run():
    class Dies:
        def start(self, scenario, scene, rows):
            raise MemoryError

        def advance(self, ticks):
            raise AssertionError("died at the start")

        def fail(self, error):
            pass

    write_log(run(short()), Path("out"))
    with pytest.raises(MemoryError):
        run(short(seed=2), (Recording(Path("out/run.rrd")), Dies()))
    assert names() == {"run.rrd"}


def test_files_from_an_earlier_run_of_another_kind_are_removed():
    ours("link.parquet", "identified.json", "run.rrd")
    write_log(run(short()), Path("out"), recorded=False)
    assert names() == FILES


# --- signals ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("times", "status", "files"), [(1, 0, FILES), (2, 130, set())])
def test_signal_while_writing_leaves_either_all_files_or_none(call, monkeypatch, times, status, files):
    whole = pq.ParquetWriter.write_table

    def interrupted(*arguments, **options):
        for _ in range(times):
            os.kill(os.getpid(), signal.SIGTERM)
        whole(*arguments, **options)

    monkeypatch.setattr(storage.pq.ParquetWriter, "write_table", interrupted)
    seen, err = call("run", "circle", *QUICK)
    assert seen == status
    assert (names() if Path("out").exists() else set()) == files
    assert ("interrupted before the end" in err) == (status == 130)


def test_operating_system_signals_are_deferred_until_all_files_are_written(call, monkeypatch):
    clear = storage.clear

    def interrupted(*arguments, **options):
        clear(*arguments, **options)
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(storage, "clear", interrupted)
    assert call("run", "circle", *QUICK)[0] == 130
    assert names() == FILES


def test_interrupted_comparison_gives_exit_status_130_and_a_message(call, monkeypatch):
    monkeypatch.setattr(tasks, "run", lambda *arguments, **options: os.kill(os.getpid(), signal.SIGTERM))
    status, err = call("compare", "circle", "--controllers", "pd", "--plants", "bicycle", *QUICK)
    assert (status, err) == (130, "interrupted before the end\n")


def test_interrupted_snapshot_leaves_no_viewer_process(call, monkeypatch):
    processes = []

    def stopped(process, port, seconds):
        processes.append(process)
        os.kill(os.getpid(), signal.SIGTERM)

    Path("run.rrd").write_bytes(b"RRF2")
    monkeypatch.setattr(snapshot, "RERUN", (sys.executable, "-c", "import time; time.sleep(60)"))
    monkeypatch.setattr(snapshot, "_connect_viewer", stopped)
    assert call("snapshot", "run.rrd")[0] == 130
    assert processes[0].poll() is not None


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux ends children with their parent when asked")
def test_viewer_ends_when_its_command_is_killed():
    code = (
        "import os, signal, sys; from agrobot_mj.recording.transport.viewer import start_viewer\n"
        "with start_viewer((sys.executable, '-c', 'import time; time.sleep(60)'), os.environ) as viewer:\n"
        "    print(viewer.pid, flush=True); os.kill(os.getpid(), signal.SIGKILL)"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[2])}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    for _ in range(100):
        if not alive(int(done.stdout)):
            break
        signal.sigtimedwait([], 0.05)
    assert not alive(int(done.stdout))


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


# --- disks --------------------------------------------------------------------------------------------------------


def test_error_for_a_full_disk_names_the_file_and_is_not_an_input_error(call, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "Error writing bytes to file. Detail: [errno 28]")

    monkeypatch.setattr(storage.pq.ParquetWriter, "write_table", full)
    assert call("run", "circle", *QUICK) == (1, f"{Path('out/signals.parquet')}: No space left on device\n")
    assert not Path("out").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
def test_unwritable_stdout_does_not_change_the_outcome():
    environment = {**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[2])}
    command = [sys.executable, "-m", "agrobot_mj", "run", "circle", *QUICK]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, env=environment, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "stdout: cannot be written: No space left on device\n")
    assert names() == FILES


def test_recording_leaves_disk_space_for_the_signals(monkeypatch, capsys):
    room = iter([10**9, 10**9, 1000, 1000, 1000])
    monkeypatch.setattr(sink.shutil, "disk_usage", lambda path: type("Usage", (), {"free": next(room)}))
    log = run(short(duration_s=40.0), (Recording(Path("out/run.rrd")),))
    assert log.outcome == "completed"
    assert "The recording ends early" in capsys.readouterr().err


def test_link_in_place_of_a_recording_is_replaced_but_a_pipe_is_rejected(call):
    Path("target").write_text("precious")
    Path("out").mkdir()
    Path("out/run.rrd").symlink_to("../target")
    ours()
    assert call("run", "circle", *QUICK[1:])[0] == 0
    assert Path("target").read_text() == "precious"
    assert not Path("out/run.rrd").is_symlink()
    Path("out/run.rrd").unlink()
    os.mkfifo("out/run.rrd")
    status, err = call("run", "circle", *QUICK[1:])
    assert status == 2
    assert "out/run.rrd: is not a regular file" in err


def test_insufficient_file_size_limit_is_reported(call, monkeypatch):
    monkeypatch.setattr(sink.resource, "getrlimit", lambda which: (1000, 1000))
    status, err = call("run", "circle", *QUICK[1:])
    assert status == 1
    assert "run.rrd: there is no space for a recording" in err


@pytest.mark.parametrize("name", ["metrics.json", "run.rrd"])
def test_a_folder_in_place_of_a_file_is_reported_before_the_run(call, name):
    Path("out", name).mkdir(parents=True)
    ours("signals.parquet")
    status, err = call("run", "circle", *QUICK)
    assert status == 2
    assert f"out/{name} is a folder" in err
    assert Path("out/signals.parquet").read_text() == "old"


def test_dangling_link_as_output_folder_is_rejected(call):
    Path("out").symlink_to("nowhere")
    status, err = call("run", "circle", *QUICK)
    assert status == 2
    assert "--out out: the folder is a broken link" in err


def test_written_files_have_the_default_permissions_of_the_user():
    before = os.umask(0o077)
    try:
        write_json(Path("a.json"), {})
        write_log(run(short()), Path("out"))
    finally:
        os.umask(before)
    modes = {stat.S_IMODE(path.stat().st_mode) for path in (Path("a.json"), *Path("out").iterdir())}
    assert modes == {0o600}
    assert json.loads(Path("a.json").read_text()) == {}


# --- other places -------------------------------------------------------------------------------------------------

OWN = """
[path]
kind = "waypoints"
file = "mine/route.csv"
speed_m_s = 1.0
[terrain]
kind = "heightmap"
file = "mine/ground.npy"
"""


@pytest.fixture
def own_files():
    """Return a scenario with its own data files."""
    Path("home/mine").mkdir(parents=True)
    Path("home/mine/route.csv").write_text("x_m,y_m\n0,0\n20,0\n20,20\n")
    np.save("home/mine/ground.npy", np.zeros((101, 101)))
    Path("home/mine.toml").write_text(OWN)
    return Path("home/mine.toml")


def test_results_folder_contains_no_absolute_paths_and_runs_elsewhere(call, own_files, tmp_path, monkeypatch):
    assert call("run", own_files, "--set", "duration_s=1", "--out", "out")[0] == 0
    assert names() == FILES | {"run.rrd", "route.csv", "ground.npy"}
    for path in Path("out").iterdir():
        assert str(tmp_path).encode() not in path.read_bytes(), path
    first = load_scenario("out/scenario.toml")
    assert first.hash8 == load_scenario(own_files, {"duration_s": 1}).hash8
    signals = Path("out/signals.parquet").read_bytes()
    Path("out").rename("moved")
    Path("home").rename("gone")
    monkeypatch.chdir("moved")
    assert call("run", "scenario.toml", "--no-rrd", "--out", "../again")[0] == 0
    assert Path("../again/signals.parquet").read_bytes() == signals


def test_two_data_files_of_equal_name_are_copied_under_different_names():
    data = {"a": {"file": "/x/f.csv"}, "b": [{"file": "/y/f.csv"}, {"file": "/x/f.csv"}], "c": {"file": "hills.asc"}}
    assert relocate_files(data) == {"f.csv": Path("/x/f.csv"), "f-2.csv": Path("/y/f.csv")}
    assert data == {"a": {"file": "f.csv"}, "b": [{"file": "f-2.csv"}, {"file": "f.csv"}], "c": {"file": "hills.asc"}}


def test_scenario_hash_depends_on_data_file_content_but_not_on_its_path(own_files):
    before = load_scenario(own_files).hash8
    Path("home").rename("elsewhere")
    assert load_scenario("elsewhere/mine.toml").hash8 == before
    Path("elsewhere/mine/route.csv").write_text("x_m,y_m\n0,0\n20,0\n20,21\n")
    assert load_scenario("elsewhere/mine.toml").hash8 != before


def test_output_folder_name_may_look_like_a_drive_letter(call):
    assert call("run", "circle", *QUICK[:-1], "a:") == (0, "")
    assert call("report", "a:", "--quiet") == (0, "")
    assert call("twin", "--only", "valve", "a:")[0] == 2  # a second is too short, and that is read


def test_result_files_do_not_replace_devices(monkeypatch):
    monkeypatch.setattr(Path, "is_char_device", lambda path: path.name == "null")
    with pytest.raises(OSError, match="is a device; specify a file"):
        write_json(Path("null"), {})
    assert not Path("null").exists()


READING = [("rig", "pipe.toml"), ("replay", "out", "--map", "pipe.toml")]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes here")
@pytest.mark.parametrize("arguments", [("sweep", "pipe.toml"), *(each for each in READING if is_there(each[0]))])
def test_pipe_as_input_file_is_rejected_without_waiting(call, arguments):
    assert call("run", "circle", *QUICK)[0] == 0
    os.mkfifo("pipe.toml")
    status, err = call(*arguments)
    assert (status, "pipe.toml: is not a regular file" in err) == (2, True)


@pytest.mark.parametrize(
    ("written", "named", "other"),
    [("signals.parquet", "a run", "sweep.parquet"), ("sweep.parquet", "a comparison or a sweep", "signals.parquet")],
)
def test_results_of_a_run_and_of_a_sweep_do_not_share_a_folder(tmp_path, written, named, other):
    with results(tmp_path / "out", (written,)) as folder:
        write_json(folder / written, {})
    with pytest.raises(ScenarioError, match=f"contains {named} .*delete the folder"), results(folder, (other,)):
        pass
    with results(folder, (written,)), results(folder / "inner", (other,)):
        pass


def test_run_folder_contains_the_coordinate_system_of_a_shapefile(tmp_path):
    for name in ("a.shp", "a.prj", "b.csv"):
        (tmp_path / name).write_text("")
    data = {"path": {"file": str(tmp_path / "a.shp")}, "terrain": {"file": str(tmp_path / "b.csv")}}
    assert set(relocate_files(data)) == {"a.shp", "a.prj", "b.csv"}
