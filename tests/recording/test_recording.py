import importlib
import json
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from processes import command, program
from recorded import Recorded, replay

from agrobot_mj import __version__, load_scenario, run
from agrobot_mj.recording import Recording
from agrobot_mj.recording.transport import viewer
from agrobot_mj.recording.transport.mending import whole
from agrobot_mj.simulation.run import CHUNK_TICKS

KILLED = """
import os, signal, sys, time
from importlib import import_module
from pathlib import Path
from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording
from agrobot_mj.simulation.run import CHUNK_TICKS

class Killed(Recording):
    def advance(self, first):
        super().advance(first)
        if first == CHUNK_TICKS:
            time.sleep(0.5)  # the writer works beside the run
            os.kill(os.getpid(), signal.SIGKILL)

import_module("agrobot_mj.simulation.run").REPORT_S = 1e9  # no earlier pieces on a busy machine
import_module("agrobot_mj.simulation.stepping").SHORTEST = float("inf")  # single ticks
run(load_scenario("straight_line", {"duration_s": 150, "plant.kind": "bicycle"}), (Killed(Path(sys.argv[1])),))
"""


CRAMPED = """
import resource, sys
from importlib import import_module
from pathlib import Path
from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording

import_module("agrobot_mj.simulation.run").CHUNK_TICKS = 200

run(load_scenario("straight_line", {"duration_s": 0.1}))  # its kernels go to the cache
resource.setrlimit(resource.RLIMIT_FSIZE, (1_200_000, 1_200_000))
log = run(load_scenario("straight_line", {"duration_s": 40}), (Recording(Path(sys.argv[1])),))
print(log.outcome)
"""

ROOMLESS = """
import resource, sys
from pathlib import Path
from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording

run(load_scenario("straight_line", {"duration_s": 0.1}))
for limit in sys.argv[2:]:
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    try:
        run(load_scenario("straight_line", {"duration_s": 40}), (Recording(Path(sys.argv[1], limit)),))
    except OSError as error:
        print(error)
"""


def verify(path):
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_recording_passes_the_verification_of_rerun(eight):
    verify(eight.path)


def test_recording_contains_name_seed_identity_and_version_of_the_run(eight):
    scenario = eight.log.scenario
    said = {key: eight.static("/__properties/scenario", key) for key in ("name", "seed", "identity", "version")}
    assert said == {
        "name": ["figure_eight"],
        "seed": [scenario.seed],
        "identity": [str(scenario.identity)],
        "version": [__version__],
    }
    info = eight.static("/info", "TextDocument:text")[0]
    assert scenario.title in info
    assert scenario.to_toml() in eight.static("/scenario", "TextDocument:text")[0]


def test_recording_contains_the_metrics_of_the_run(eight):
    metrics = json.loads(json.dumps(eight.log.metrics))  # as in metrics.json
    info = eight.static("/info", "TextDocument:text")[0]
    for name, value in metrics.items():
        if isinstance(value, int | float):
            assert eight.static("/__properties/metrics", name) == [value]
            assert f"| {name} | {value:.4g} |" in info
    assert eight.static("/__properties/metrics", "outcome") == ["completed"]
    table = info.split("Turn by turn")[1]
    assert "turn 1 (in part)" in table
    for name, value in metrics["per_turn"][0].items():
        assert name in ("turn", "complete") or f"| {name} | {value:.4g} |" in table
    assert f"| nn_share | {metrics['nn_share'][0]:.4g} |" in table


def test_recording_shows_pass_to_pass_accuracy_and_expected_outcome(tmp_path):
    path = tmp_path / "run.rrd"
    scenario = load_scenario("one_hectare", {"duration_s": 190, "plant.kind": "bicycle"})
    log = run(scenario.model_copy(update={"expected_outcome": "stuck"}), (Recording(path),))
    info, found = Recorded(path).static("/info", "TextDocument:text")[0], log.metrics["iso_12188_2_style"]
    assert "**completed** after 190.00 s" in info
    assert "**expected: stuck**" in info
    assert f"| pass_to_pass_p95_m | {found['pass_to_pass_p95_m']:.4g} | m |" in info
    numbers = " | ".join(f"{found['per_pass'][0][name]:.4g}" for name in ("xte_mean", "xte_rms", "xte_abs_p95"))
    assert f"| 1 | {numbers} |" in info


@pytest.mark.usefixtures("single_ticks")
def test_recording_of_an_aborted_run_is_complete_up_to_its_end(tmp_path):
    ticks = iter(range(10_000))
    path = tmp_path / "run.rrd"
    recording = Recording(path)  # kept, so that it is not its end that closes the file
    log = run(load_scenario("straight_line"), (recording,), lambda: next(ticks) == 229)
    with warnings.catch_warnings(action="error"):  # of a missing footer
        recorded = Recorded(path)
        recorded.identity()
    times, _ = recorded.column("/plots/speed/loop", "Scalars:scalars")
    assert log.outcome == "aborted"
    np.testing.assert_array_equal(times, np.arange(230) * 50_000_000)
    assert "**aborted** after 11.50 s" in recorded.static("/info", "TextDocument:text")[0]
    verify(path)


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_recording_of_a_killed_run_contains_the_data_before_the_kill(tmp_path):
    path = tmp_path / "run.rrd"
    done = program(tmp_path, KILLED, path)
    assert done.returncode == -9, done.stderr
    recorded = Recorded(path)
    times, _ = recorded.column("/plots/tracking/error", "Scalars:scalars")
    assert times[-1] == (2 * CHUNK_TICKS - 1) * 50_000_000
    assert len(recorded.column("/world/bodies/chassis", "Transform3D:translation")[0]) == 2 * CHUNK_TICKS
    assert "The run is active or was killed" in recorded.static("/info", "TextDocument:text")[0]


def test_interrupt_after_the_first_rows_keeps_the_recording(tmp_path):
    class Interrupting(Recording):
        def advance(self, first):
            super().advance(first)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(
            load_scenario("straight_line", {"duration_s": 2.0, "plant.kind": "bicycle"}),
            (Interrupting(tmp_path / "run.rrd"),),
        )
    assert (tmp_path / "run.rrd").is_file()


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
@pytest.mark.parametrize("extra_bytes", [0, pytest.param(150_000, marks=pytest.mark.slow)])
def test_kill_9_in_mid_run_leaves_the_signals_up_to_the_last_flush(tmp_path, extra_bytes):
    command = [
        sys.executable,
        "-m",
        "agrobot_mj",
        "run",
        "straight_line",
        "--set",
        "duration_s=3000",
        "--out",
        tmp_path,
    ]
    environment = {**os.environ, "PYTHONPATH": str(Path(viewer.__file__).parents[3])}
    path, pipes = tmp_path / "run.rrd", {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, env=environment, **pipes) as process:
        deadline = time.monotonic() + 300
        while not path.exists() or path.stat().st_size < 1_500_000 + extra_bytes:
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    with whole(path) as readable:
        recorded = Recorded(readable)
        times, values = recorded.column("/plots/tracking/error", "Scalars:scalars")
        assert len(times) >= 200
        np.testing.assert_array_equal(times, np.arange(len(times)) * 50_000_000)
        assert np.isfinite(values).all()
        assert "The run is active or was killed" in recorded.static("/info", "TextDocument:text")[0]


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_recording_on_a_full_disk_is_readable_and_the_run_continues(tmp_path):
    path = tmp_path / "run.rrd"
    done = program(tmp_path, CRAMPED, path)
    assert (done.returncode, done.stdout) == (0, "completed\n"), done.stderr
    assert "check the disk space. The recording ends early" in done.stderr
    assert path.stat().st_size < 1_200_000
    assert len(Recorded(path).column("/plots/tracking/error", "Scalars:scalars")[0]) >= 200


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_recording_without_disk_space_for_its_footer_is_readable(tmp_path):
    run(load_scenario("straight_line", {"duration_s": 40}), (Recording(tmp_path / "whole.rrd"),))
    whole = (tmp_path / "whole.rrd").stat().st_size
    path = tmp_path / "run.rrd"
    code = CRAMPED.replace("1_200_000", str(whole - 20_000))
    done = program(tmp_path, code, path)
    assert (done.returncode, done.stdout) == (0, "completed\n"), done.stderr
    assert "The recording ends early" in done.stderr
    assert len(Recorded(path).column("/plots/tracking/error", "Scalars:scalars")[0]) >= 600


def test_recording_without_disk_space_for_the_scene_fails_at_once(tmp_path):
    limits = [20_000, 50_000, 80_000]
    done = program(tmp_path, ROOMLESS, tmp_path, *map(str, limits))
    assert done.returncode == 0, done.stderr
    for limit, said in zip(limits, done.stdout.splitlines(), strict=True):
        assert f"no space for a recording: '{tmp_path / str(limit)}'" in said
        assert not (tmp_path / str(limit)).exists()


@pytest.mark.usefixtures("single_ticks")
def test_error_message_that_ends_a_run_is_in_the_recording(short, tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.import_module("agrobot_mj.simulation.run"), "CHUNK_TICKS", 200)

    class Failing(Recording):
        def advance(self, first):
            super().advance(first)
            if first == 200:
                raise FloatingPointError("too much")

    path = tmp_path / "run.rrd"
    recording = Failing(path)
    with pytest.raises(FloatingPointError, match="too much"):
        run(load_scenario("straight_line", {"duration_s": 30}), (recording,))
    recorded = Recorded(path)
    info = recorded.static("/info", "TextDocument:text")[0]
    assert "**ended by an error** after 20.00 s: `FloatingPointError: too much`" in info
    assert len(recorded.column("/plots/tracking/error", "Scalars:scalars")[0]) == 400
    verify(path)


@pytest.mark.usefixtures("single_ticks")
def test_recording_of_a_slow_run_is_flushed_at_wall_time_intervals(monkeypatch, tmp_path):
    whole_runs = importlib.import_module("agrobot_mj.simulation.run")

    told = []

    class Listening(Recording):
        def advance(self, first):
            told.append(first)
            super().advance(first)

    monkeypatch.setattr(whole_runs, "REPORT_S", 0.0)
    path = tmp_path / "run.rrd"
    run(load_scenario("straight_line", {"duration_s": 1}), (Listening(path),))
    assert told == [*range(20), 20]
    assert len(Recorded(path).column("/plots/tracking/error", "Scalars:scalars")[0]) == 20


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_recording_of_the_previous_rerun_version_is_readable():
    path = Path(__file__).parent / "data" / "written_by_0_40.rrd"
    recorded = Recorded(path)
    times, values = recorded.column("/plots/tracking/error", "Scalars:scalars")
    np.testing.assert_array_equal(times, np.arange(200) * 50_000_000)
    np.testing.assert_allclose(np.array(values)[:, 0], np.sin(np.arange(200) / 20))
    named_then = ["longitudinal [m]", "lateral [m]"]
    assert recorded.static("/plots/tracking/error", "SeriesLines:names") == named_then
    assert recorded.static("/__properties/scenario", "hash") == ["0123abcd"]
    assert len(recorded.column("/world/bodies/chassis", "Transform3D:translation")[0]) == 200
    verify(path)


def test_recording_of_a_diverged_run_ends_at_its_last_position(short, tmp_path):
    short.rows.values[-3:, short.rows.columns.index("x")] = np.nan
    recorded = replay(short, tmp_path / "run.rrd")
    assert len(recorded.column("/world/bodies/chassis", "Transform3D:translation")[0]) == len(short.column("t")) - 3
    assert len(recorded.column("/plots/speed/loop", "Scalars:scalars")[0]) == len(short.column("t"))


def test_recording_of_a_second_run_replaces_the_first_recording(short, tmp_path):
    ids = []
    for _ in range(2):
        replay(short, tmp_path / "run.rrd")
        ids.append(Recorded(tmp_path / "run.rrd").identity())
    assert ids[0] != ids[1]
    assert {application for application, _ in ids} == {"agrobot_mj"}


def test_unwritable_recording_file_raises_os_error(tmp_path):
    (tmp_path / "file").touch()
    scenario = load_scenario("straight_line", {"duration_s": 1})
    for path in (tmp_path / "file" / "run.rrd", tmp_path):
        with pytest.raises(OSError, match=str(tmp_path)):
            run(scenario, (Recording(path),))


def test_live_run_without_a_viewer_continues(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(viewer, "COMMAND", (sys.executable, "-c", ""))
    monkeypatch.setattr(viewer, "PORT", 1)
    path = tmp_path / "run.rrd"
    log = run(load_scenario("straight_line", {"duration_s": 1}), (Recording(path, live=True),))
    assert log.outcome == "completed"
    assert "the Rerun viewer did not start" in capsys.readouterr().err
    assert len(Recorded(path).column("/plots/speed/loop", "Scalars:scalars")[0]) == 20


@pytest.mark.parametrize("switch", ["off", "0", "FALSE"])
def test_run_with_rerun_disabled_writes_its_results(tmp_path, switch):
    short = ("run", "circle", "--set", "duration_s=0.7", "--set", "plant.kind=bicycle", "--out", "out")
    assert command(tmp_path, *short).returncode == 0
    assert (tmp_path / "out" / "run.rrd").is_file()
    done = command(tmp_path, *short, RERUN=switch)
    assert done.returncode == 0, done.stderr
    assert f"RERUN={switch}: Rerun is disabled, so no recording is written" in done.stderr
    assert "Traceback" not in done.stderr
    written = {path.name for path in (tmp_path / "out").iterdir() if not path.name.startswith(".")}
    assert written == {"metrics.json", "scenario.toml", "signals.parquet"}  # the recording of another run is gone


def test_comparison_with_rerun_disabled_draws_its_figures(tmp_path):
    keys = ("--set", "duration_s=0.7", "--plants", "bicycle", "--controllers", "pd,pd_t2fnn", "--jobs", "1")
    done = command(tmp_path, "compare", "circle", *keys, "--out", "out", RERUN="off")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("Rerun is disabled") == 1
    assert (tmp_path / "out" / "trajectory.png").is_file()
    assert not list((tmp_path / "out").rglob("*.rrd"))


def test_recording_can_be_used_for_a_second_run(tmp_path):
    recording = Recording(tmp_path / "run.rrd")
    for _ in range(2):
        run(load_scenario("straight_line", {"duration_s": 1}), (recording,))
    assert len(Recorded(tmp_path / "run.rrd").column("/plots/tracking/error", "Scalars:scalars")[0]) == 20
