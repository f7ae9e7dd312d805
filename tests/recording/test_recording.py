import subprocess
import sys
import warnings

import numpy as np
import pytest
from recorded import Recorded, replay

from agrobot_mj import __version__, load_scenario, run
from agrobot_mj.recording import Recording, viewer

KILLED = """
import os, signal, sys, time
from pathlib import Path
from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording

class Killed(Recording):
    def advance(self, first):
        super().advance(first)
        if first == 200:
            time.sleep(0.5)  # the writer works beside the run
            os.kill(os.getpid(), signal.SIGKILL)

run(load_scenario("straight_line"), (Killed(Path(sys.argv[1])),))
"""


def verify(path):
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_rerun_finds_no_fault(eight):
    verify(eight.path)


def test_says_what_it_records(eight):
    scenario = eight.log.scenario
    said = {key: eight.static("/__properties/scenario", key) for key in ("name", "seed", "hash", "version")}
    assert said == {
        "name": ["figure_eight"],
        "seed": [scenario.seed],
        "hash": [scenario.hash8],
        "version": [__version__],
    }
    info = eight.static("/info", "TextDocument:text")[0]
    assert scenario.title in info
    assert scenario.to_toml() in info


def test_agrees_with_the_metrics(eight):
    metrics = eight.log.metrics
    info = eight.static("/info", "TextDocument:text")[0]
    for name, value in metrics.items():
        if isinstance(value, float):
            assert eight.static("/__properties/metrics", name) == [value]
            assert f"| {name} | {value:.6g} |" in info
    assert eight.static("/__properties/metrics", "outcome") == ["completed"]
    first = metrics["per_turn"][0]
    assert "turn 1 (in part)" in info
    assert f"| xte_rms | {first['xte_rms']:.6g} | m |" in info.split("Turn by turn")[1]


def test_an_aborted_run_is_whole_as_far_as_it_went(tmp_path):
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
def test_a_killed_run_leaves_what_was_told_before(tmp_path):
    path = tmp_path / "run.rrd"
    done = subprocess.run([sys.executable, "-c", KILLED, path], capture_output=True, text=True, check=False)
    assert done.returncode == -9, done.stderr
    recorded = Recorded(path)
    times, _ = recorded.column("/plots/tracking/error", "Scalars:scalars")
    assert times[-1] == 399 * 50_000_000
    assert len(recorded.column("/world/bodies/chassis", "Transform3D:translation")[0]) == 400
    assert "Still running, or killed" in recorded.static("/info", "TextDocument:text")[0]


def test_a_run_that_blew_up_is_recorded_to_its_last_position(short, tmp_path):
    short.rows.values[-3:, short.rows.columns.index("x")] = np.nan
    recorded = replay(short, tmp_path / "run.rrd")
    assert len(recorded.column("/world/bodies/chassis", "Transform3D:translation")[0]) == len(short.column("t")) - 3
    assert len(recorded.column("/plots/speed/loop", "Scalars:scalars")[0]) == len(short.column("t"))


def test_a_second_run_replaces_the_first_and_is_another_recording(short, tmp_path):
    ids = []
    for _ in range(2):
        replay(short, tmp_path / "run.rrd")
        ids.append(Recorded(tmp_path / "run.rrd").identity())
    assert ids[0] != ids[1]
    assert {application for application, _ in ids} == {"agrobot_mj"}


def test_a_file_that_cannot_be_written_is_an_os_error(tmp_path):
    (tmp_path / "file").touch()
    scenario = load_scenario("straight_line", {"duration_s": 1})
    for path in (tmp_path / "file" / "run.rrd", tmp_path):
        with pytest.raises(OSError, match=str(tmp_path)):
            run(scenario, (Recording(path),))


def test_without_a_viewer_a_live_run_goes_on(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(viewer, "COMMAND", (sys.executable, "-c", ""))
    monkeypatch.setattr(viewer, "PORT", 1)
    path = tmp_path / "run.rrd"
    log = run(load_scenario("straight_line", {"duration_s": 1}), (Recording(path, live=True),))
    assert log.outcome == "completed"
    assert "no Rerun viewer" in capsys.readouterr().err
    assert len(Recorded(path).column("/plots/speed/loop", "Scalars:scalars")[0]) == 20
