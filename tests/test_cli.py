"""Command line: printed text, written files and exit status.

Commands run in this process if possible; one test starts the real command.
"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from removed import is_there
from typer.main import get_command

from agrobot_mj import Simulation, __version__, cli
from agrobot_mj.control import nmpc
from agrobot_mj.plants.mujoco.settling import RecentMotion
from agrobot_mj.scenario.loading import load_scenario, scenario_files
from agrobot_mj.simulation import loop as simulate
from agrobot_mj.simulation.results import MARK

FILES = {"signals.parquet", "metrics.json", "scenario.toml"}
QUICK = ("--no-rrd", "--set", "duration_s=2", "--set", "plant.kind=bicycle")


@pytest.fixture(autouse=True)
def elsewhere(call, tmp_path, monkeypatch):
    """Run every test in a separate empty folder."""
    folder = tmp_path / "cwd"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def names(folder):
    return {path.name for path in Path(folder).iterdir()} - {MARK}


# --- list, version, help ------------------------------------------------------------------------------------------


def test_list_prints_one_line_per_scenario(call):
    status, out, err = call("list")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert [line.split()[0] for line in lines] == list(scenario_files())
    assert all(load_scenario(line.split()[0]).title in line for line in lines)


def test_version_and_help_options_work(call):
    assert call("--version")[:2] == (0, f"{__version__}\n")
    status, out, _ = call("--help")
    assert status == 0
    assert all(command in out for command in ("list", "run", "compare", "view", "--help-all"))


def test_command_works_from_any_working_folder(elsewhere):
    command = [sys.executable, "-m", "agrobot_mj", "list"]
    environment = {**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[2])}
    done = subprocess.run(command, cwd=elsewhere, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "figure_eight" in done.stdout


def modules_after(folder, *arguments):
    """Return the names of all modules imported by a command in a separate process."""
    code = f"import sys; from agrobot_mj.cli import app; app({arguments!r}, standalone_mode=False); print(*sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[2])}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


HEAVY = ("mujoco", "numba", "filterpy", "pyarrow", "rerun", "matplotlib", "scipy", "numpy")


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["list"], ["run", "--help"]])
def test_commands_that_do_not_simulate_do_not_import_the_simulator(elsewhere, arguments):
    modules = modules_after(elsewhere, *arguments)
    assert "agrobot_mj.cli.runs" in modules
    assert not modules & set(HEAVY)


IDLE = ("filterpy", "matplotlib", "plotly", "rerun", "PIL", "pandas", "SALib", "distributed", "gymnasium")
IDLE_OF_SCIPY = ("optimize", "stats", "signal", "interpolate", "integrate", "ndimage", "spatial")


def test_run_imports_no_unnecessary_libraries(elsewhere):
    overrides = ("--set", "duration_s=0.1", "--set", "plant.kind=bicycle")
    modules = modules_after(elsewhere, "run", "circle", *overrides, "--no-rrd", "--quiet")
    assert {"numba", "pyarrow", "agrobot_mj.simulation.run"} <= modules
    assert not modules & {*IDLE, *(f"scipy.{part}" for part in IDLE_OF_SCIPY)}


@pytest.mark.parametrize(
    "command", ["--help", "--help-all", *(f"{name} --help" for name in sorted(get_command(cli.app).commands))]
)
def test_help_fits_80_columns_without_truncated_text(call, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "80")
    status, out, _ = call(*command.split())
    assert status == 0
    assert max(map(len, out.splitlines())) <= 80
    assert "..." not in re.sub(r"S,S,\.\.\.|ARGS\]\.\.\.|(SWEEP\.toml|LOG)\}\.\.\.", "", out)


def test_shell_completion_offers_commands_and_scenarios(monkeypatch, elsewhere):
    for words, last, offered in (("agrobot-mj ru", 1, {"run"}), ("agrobot-mj run side_slope_1", 2, None)):
        settings = {"_AGROBOT_MJ_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(last)}
        code = "import sys; sys.argv = ['agrobot-mj']; from agrobot_mj.cli import main; main()"
        environment = {**os.environ, **settings, "PYTHONPATH": str(Path(cli.__file__).parents[2])}
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, cwd=elsewhere, env=environment, capture_output=True, text=True, check=False)
        expected = offered or {name for name in scenario_files() if name.startswith("side_slope_1")}
        assert set(done.stdout.split()) == expected


# --- help for writing scenarios -----------------------------------------------------------------------------------


def test_list_explain_and_schema_commands_print_their_output(call):
    status, out, err = call("list", "--kinds")
    assert (status, err) == (0, "")
    assert any(line.split()[:2] == ["plant.tyre", "soil"] for line in out.splitlines())
    status, out, err = call("explain", "path.radius_m")
    assert (status, err) == (0, "")
    assert "figure_eight" in out
    assert call("explain")[0] == 0
    status, out, err = call("schema")
    assert (status, err) == (0, "")
    assert "plant" in json.loads(out)["properties"]


def test_new_scenario_from_init_can_be_run_and_is_not_overwritten(call, elsewhere):
    status, out, err = call("init", "mine")
    assert (status, err) == (0, "")
    assert "agrobot-mj run mine.toml" in out
    assert call("run", "mine.toml", *QUICK, "--out", "out")[0] == 0
    assert load_scenario("out/scenario.toml").title == "mine"
    assert call("init", "mine")[0] == 2


@pytest.mark.parametrize(("name", "shown"), [("x y", "'x y.toml'"), ("-x", "./-x.toml"), ("a$b", "'a$b.toml'")])
def test_command_printed_by_init_is_quoted_for_the_shell(call, elsewhere, name, shown):
    status, out, _ = call("init", "--", name)
    assert status == 0
    assert f"run it with `agrobot-mj run {shown}`" in out


# --- run ----------------------------------------------------------------------------------------------------------


def test_run_command_writes_its_files_and_prints_its_outcome(call, elsewhere):
    status, out, err = call("run", "straight_line", *QUICK)
    assert (status, err) == (0, "")
    scenario = load_scenario("straight_line", {"duration_s": 2, "plant.kind": "bicycle"})
    folder = elsewhere / "runs" / f"straight_line-{scenario.hash8}"
    assert names(folder) == FILES
    line, parts = out.splitlines()
    assert " cm cross-track: " in parts
    assert "completed" in line
    assert str(folder.relative_to(elsewhere)) in line
    assert json.loads((folder / "metrics.json").read_text())["outcome"] == "completed"
    assert pq.read_table(folder / "signals.parquet").num_rows == 40
    assert load_scenario(folder / "scenario.toml") == scenario


@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_run_of_a_saved_scenario_file_repeats_its_signals(call, plant):
    changes = ("--set", f"plant.kind={plant}", "--set", "seed=11", "--set", "tractor.mass_kg=741.3")
    assert call("run", "circle", "--no-rrd", "--set", "duration_s=2", *changes, "--out", "first")[0] == 0
    assert call("run", "first/scenario.toml", "--no-rrd", "--out", "second")[0] == 0
    assert Path("first/signals.parquet").read_bytes() == Path("second/signals.parquet").read_bytes()
    assert Path("first/scenario.toml").read_bytes() == Path("second/scenario.toml").read_bytes()


def test_recording_a_run_does_not_change_its_signals(call):
    for out, more in (("with", ()), ("without", ("--no-rrd",))):
        assert call("run", "circle", "--set", "duration_s=2", "--out", out, *more)[0] == 0
    assert names("with") == FILES | {"run.rrd"}
    assert Path("with/run.rrd").stat().st_size > 10_000
    assert Path("with/signals.parquet").read_bytes() == Path("without/signals.parquet").read_bytes()


def test_second_run_into_the_same_folder_replaces_the_files(call):
    call("run", "circle", *QUICK, "--out", "here")
    call("run", "circle", *QUICK, "--set", "duration_s=1", "--out", "here")
    assert names("here") == FILES
    assert pq.read_table("here/signals.parquet").num_rows == 20


def test_override_values_may_be_toml_or_words_without_quotes(call):
    given = ("path.kind=circle", 'path.direction="right"', "path.radius_m = 6", "title=a = b")
    sets = [word for text in given for word in ("--set", text)]
    assert call("run", "straight_line", *QUICK, *sets, "--out", "out")[0] == 0
    scenario = load_scenario("out/scenario.toml")
    assert (scenario.path.kind, scenario.path.direction, scenario.path.radius_m) == ("circle", "right", 6.0)
    assert scenario.title == "a = b"


def test_scenario_name_cannot_write_outside_the_output_folder(call, elsewhere):
    status, _, _ = call("run", "circle", *QUICK, "--set", "name=../../evil")
    assert status in (0, 2)
    assert names(elsewhere.parent) == {elsewhere.name}


def test_scenario_with_tyre_keys_runs_on_a_plant_without_tyre_model(call):
    assert call("run", "step_steer", *QUICK, "--out", "out")[0] == 0


@pytest.mark.parametrize(
    "arguments", [("run", "circle"), ("compare", "circle", "--controllers", "pd", "--plants", "bicycle")]
)
def test_quiet_option_prints_nothing_for_a_successful_run(call, arguments):
    assert call(*arguments, *QUICK, "--out", "out", "--quiet") == (0, "", "")
    assert names("out")


# --- runs that end otherwise --------------------------------------------------------------------------------------


def test_run_with_its_expected_outcome_gives_exit_status_0(call, undrawn):
    off = ("--no-rrd", "--set", "terrain.half_size_m=2", "--set", "plant.kind=bicycle", "--out", "out")
    expected = ("--set", "expected_outcome=left_terrain")
    status, out, err = call("run", "straight_line", *off, *expected)
    assert (status, err) == (0, "")
    assert "left_terrain" in out
    status, _, err = call("run", "circle", *QUICK, *expected, "--out", "other")
    assert status == 1
    assert re.fullmatch(r"circle: completed after [\d.]+ s; expected_outcome is left_terrain\n", err)
    assert (
        call("compare", "straight_line", "--controllers", "pd", "--plants", "bicycle", *off, *expected, "--out", "all")[
            0
        ]
        == 0
    )


@pytest.mark.parametrize(
    ("outcome", "sets"),
    [
        ("left_terrain", ["terrain.half_size_m=2", "plant.kind=bicycle"]),
        ("rolled_over", ["terrain.kind=slope", "terrain.grade_deg=44.0", "plant.settle_s=0.0"]),
        ("stuck", ["fault=[{kind='drawbar', pull_n=8000.0}]"]),
        ("stuck", ["plant.tyre={kind='soil', cone_index_kpa=60.0}"]),
    ],
)
def test_unexpected_outcome_gives_exit_status_1_and_keeps_the_files(call, outcome, sets):
    options = [word for text in sets for word in ("--set", text)]
    status, out, err = call("run", "straight_line", "--no-rrd", "--set", "duration_s=20", *options, "--out", "out")
    assert status == 1
    assert outcome in err
    assert "Traceback" not in err + out
    assert names("out") == FILES
    assert json.loads(Path("out/metrics.json").read_text())["outcome"] == outcome
    assert 1 <= pq.read_table("out/signals.parquet").num_rows < 400


def test_message_about_an_unexpected_outcome_names_the_active_faults(call):
    faults = "fault=[{kind='gnss_loss'}, {kind='gyro_bias', bias_deg_s=0.01}, {kind='gyro_stuck', start_s=1, end_s=2}]"
    options = ("--no-rrd", "--set", "plant.kind=bicycle", "--set", "duration_s=20", "--set", faults)
    said = call("run", "circle", *options, "--out", "out")[2].splitlines()[-1]
    assert re.search(r"stopped after [\d.]+ s during gnss_loss, gyro_bias \(no GNSS fix for", said)


@pytest.mark.usefixtures("single_ticks")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_to_the_process_aborts_the_run_and_its_files_are_kept(call, monkeypatch, number):
    def not_handled(*_):
        raise AssertionError("the run did not take the signal")

    before = signal.signal(number, not_handled)
    tick, seen = simulate.Loop.act, []

    def tick_with_signal(loop, *messages):
        seen.append(1)
        if len(seen) == 12:
            os.kill(os.getpid(), number)
        return tick(loop, *messages)

    monkeypatch.setattr(simulate.Loop, "act", tick_with_signal)
    try:
        status, _, err = call("run", "straight_line", "--no-rrd", "--set", "duration_s=60", "--out", "out")
        assert signal.getsignal(number) is not_handled  # put back
    finally:
        signal.signal(number, before)
    assert status == 1
    assert "aborted" in err
    assert names("out") == FILES
    assert json.loads(Path("out/metrics.json").read_text())["outcome"] == "aborted"
    assert 12 <= pq.read_table("out/signals.parquet").num_rows <= 13


@pytest.mark.parametrize(
    ("number", "kind", "method"),
    [(signal.SIGTERM, RecentMotion, "add"), (signal.SIGINT, RecentMotion, "add"), (signal.SIGINT, Simulation, "reset")],
    ids=["terminated", "while settling", "while recording"],
)
def test_signal_during_the_start_cancels_a_run_without_files(call, monkeypatch, number, kind, method):
    """The run is interrupted in the first of several hundred ticks in which the tractor settles."""
    before, calls = getattr(kind, method), []

    def with_signal(*given):
        calls.append(1)
        os.kill(os.getpid(), number)
        return before(*given)

    monkeypatch.setattr(kind, method, with_signal)
    status, out, err = call("run", "side_slope_10", "--out", "out")
    assert (status, out, err.splitlines()[-1:]) == (130, "", ["interrupted before the end"])
    assert "Traceback" not in err
    assert len(calls) == 1
    assert not Path("out").exists()


# --- bad input ----------------------------------------------------------------------------------------------------


BAD = [
    (["run", "figure_eigth"], "did you mean 'figure_eight'"),
    (["run", "missing.toml"], "missing.toml: no such file"),
    (["run", "."], "folder"),
    (["run", os.devnull], f"{os.devnull}: is not a regular file; specify an existing file"),
    (["twin", "--describe", os.devnull], f"{os.devnull}: is not a regular file; specify an existing file"),
    (["view", os.devnull], f"{os.devnull}: is not a regular file; specify a recording"),
    (["report", "broken.toml"], "broken.toml: is a file; specify its folder"),
    (["report", "broken.toml", "--share"], "broken.toml: is a file; specify its folder"),
    (["twin", "broken.toml", "--from", "5", "--to", "3"], "--from 5 --to 3: the end must be later than the start"),
    (["link", "circle", "--port", "9999"], "--port 9999: the guidance program uses this port (--host-port)"),
    (["view", "."], ".: is a folder; specify a recording"),
    (["run", "broken.toml"], "broken.toml: not valid TOML"),
    (["run", "wrong.toml"], "wrong.toml: terrain.grade_deg: must be below 45"),
    (["run", "circle", "--set", "sead=3"], "sead: unknown key; did you mean 'seed'?"),
    (["run", "circle", "--set", "path.radius_m=wide"], "path.radius_m: must be a number"),
    (["run", "circle", "--set", "path.radius_m=nan"], "path.radius_m: must be a finite number"),
    (["run", "circle", "--set", "path.radius_m=-inf"], "path.radius_m: must be"),
    (["run", "circle", "--set", "physics_dt_s=0.003"], "physics_dt_s: 0.003 does not divide the 0.05 s tick; try "),
    (["run", "circle", "--set", "plant.kind=bicycle", "--set", "terrain.kind=slope"], "terrain.kind: "),
    (
        ["run", "circle", "--set", "plant.tyre.kind=liner"],
        "plant.tyre.kind: unknown kind 'liner'; did you mean 'linear'?",
    ),
    (["run", "circle", "--set", "seed"], "key=value"),
    (["run", "circle", "--set", "=3"], "key=value"),
    (["run", "circle", "--set", "seed.x=3"], "seed is not a table"),
    (["run", "circle", "--set", "tractor.rear_wheel_mass_kg=400"], "tractor.mass_kg"),
    (["run", "circle", "--set", "tractor.mass_kg=1e300"], "tractor"),
    (["run", "circle", "--out", "broken.toml"], "--out broken.toml is a file"),
    (["run", "circle", "--out", "broken.toml/x", *QUICK], "Not a directory"),
    (["run", "circle", "--out", "/proc/nowhere/x", *QUICK], "/proc/nowhere"),
    (["run", "circle", "--out=", *QUICK], "--out= is blank"),
    (["run", ""], "an argument is blank"),
    (["report", ""], "an argument is blank"),
    (["run", "circle", "--frobnicate"], "--frobnicate"),
    (["run"], "SCENARIO"),
    (["fly"], "fly"),
    (["compare", "circle", "--controllers", "pd,pdd"], "controller.kind: unknown kind 'pdd'"),
    (["compare", "circle", "--controllers", ","], "--controllers"),
    (["compare", "circle", "--plants", "bicicle"], "did you mean 'bicycle'"),
    (["compare", "circle", "--seeds", "0"], "--seeds"),
    (["compare", "circle", "--seeds", "300000"], "1200000 runs are planned"),
    (["compare", "circle", "--guidance", "lqg"], "did you mean 'lqr'"),
    (["compare", "circle", "--variant", "worn steering.valve=1"], "must have the form"),
    (["compare", "circle", "--variant", "worn: steering.valve.dead_band=1"], "did you mean 'dead_band_v'"),
    (["compare", "nothing"], "unknown scenario 'nothing'"),
    (["export", ".", "--mcap"], ".: the folder has no scenario.toml; specify the folder of a run"),
    (["export", "."], "export: no format is specified; add --mcap"),
    (["ros2", "circle", "--pace", "slow"], "--pace"),
    (["explain", "tractor.wheelbase"], "did you mean 'tractor.wheelbase_m'"),
    (["init", "\udcff"], "the text is not valid UTF-8"),
    (["init", "broken"], "broken.toml: the file already exists"),
    (["init", "nowhere/mine"], "nowhere/mine.toml"),
    (["view", "missing.rrd"], "missing.rrd: no such file"),
    (["view", "broken.toml"], "not a Rerun recording"),
    (["snapshot", "missing.rrd"], "missing.rrd: no such file"),
    (["snapshot", "broken.toml"], "not a Rerun recording"),
]
BAD = [(arguments, message) for arguments, message in BAD if is_there(arguments[0])]


@pytest.mark.parametrize(("arguments", "message"), BAD, ids=[" ".join(arguments)[:50] for arguments, _ in BAD])
def test_invalid_input_gives_exit_status_2_and_one_message(call, elsewhere, arguments, message):
    (elsewhere / "broken.toml").write_text("a = = 3")
    (elsewhere / "wrong.toml").write_text('[terrain]\nkind = "slope"\ngrade_deg = 80\n')
    status, out, err = call(*arguments)
    assert status == 2
    assert message in err
    assert out == ""
    assert "Traceback" not in err
    assert "Warning" not in err
    assert names(elsewhere) == {"broken.toml", "wrong.toml"}


@pytest.mark.parametrize("command", [("view", "--web"), ("snapshot",)])
def test_error_for_a_recording_of_an_older_viewer_states_both_versions(call, elsewhere, command):
    (elsewhere / "old.rrd").write_bytes(b"RRF2" + bytes([0, 22, 1, 0]) + bytes(100))
    status, out, err = call(*command, "old.rrd")
    assert (status, out) == (2, "")
    assert "old.rrd: the recording was written by Rerun 0.22, but the viewer needs 0.23 or later; repeat the run" in err
    assert names(elsewhere) == {"old.rrd"}


def test_a_deleted_working_directory_is_reported(call, monkeypatch, tmp_path):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    status, _, err = call("run", "circle", "--out", tmp_path / "out", *QUICK)
    monkeypatch.chdir(tmp_path)
    assert (status, err) == (2, "the working directory no longer exists; change to another one\n")


def test_invalid_output_folder_is_reported_before_the_run(call, monkeypatch, elsewhere):
    (elsewhere / "file").write_text("")
    monkeypatch.setattr(simulate.Loop, "act", lambda *_: pytest.fail("ran all the same"))
    assert call("run", "circle", "--no-rrd", "--out", "file/inside")[0] == 2


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere there is always a display")
def test_view_command_without_a_display_names_alternatives(call, monkeypatch, elsewhere):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    (elsewhere / "run.rrd").write_bytes(b"RRF2")
    status, out, err = call("view", "run.rrd")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "--web run.rrd" in err
    assert "snapshot run.rrd" in err


EXTRAS = [
    ("casadi", ("run", "circle", "--set", "guidance.kind=nmpc", "-q"), 'needs casadi; pip install "agrobot-mj[nmpc]"'),
    ("rclpy", ("ros2", "circle", "-q"), 'ros2 needs rclpy; pip install "agrobot-mj[ros]"'),
    ("mcap_ros2.writer", ("export", "run", "--mcap"), 'needs mcap_ros2; pip install "agrobot-mj[mcap]"'),
]


@pytest.mark.parametrize(("module", "arguments", "command"), [each for each in EXTRAS if is_there(each[1][0])])
def test_error_for_a_missing_extra_gives_the_install_command(call, monkeypatch, module, arguments, command):
    assert call("run", "circle", *QUICK, "-q", "--out", "run")[0] == 0
    monkeypatch.setitem(sys.modules, module, None)
    nmpc._solver.cache_clear()  # a solver of another test would be used, and crash without its module
    status, out, err = call(*arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert command in err
    assert names(".") == {"run"}


# --- compare ------------------------------------------------------------------------------------------------------


def test_comparison_of_one_run_writes_folder_table_and_figures(call):
    arguments = ("--controllers", "pd", "--plants", "bicycle", "--no-rrd", "--set", "duration_s=3", "--out", "cmp")
    status, out, err = call("compare", "circle", *arguments)
    assert (status, err) == (0, "")
    assert names("cmp/bicycle-pd-s1") == FILES
    (row,) = json.loads(Path("cmp/comparison.json").read_text())
    assert (row["plant"], row["controller"], row["seed"], row["outcome"]) == ("bicycle", "pd", 1, "completed")
    assert row["lateral_mse"] == json.loads(Path("cmp/bicycle-pd-s1/metrics.json").read_text())["lateral_mse"]
    assert len(list(Path("cmp").glob("*.png"))) >= 5
    assert "bicycle" in out
    assert "pd" in out


def test_comparison_with_a_failed_run_gives_exit_status_1(call, undrawn):
    arguments = ("--controllers", "pd", "--plants", "bicycle", "--no-rrd", "--set", "terrain.half_size_m=2.0")
    status, _, _ = call("compare", "straight_line", *arguments, "--out", "cmp")
    assert status == 1
    assert json.loads(Path("cmp/comparison.json").read_text())[0]["outcome"] == "left_terrain"


def test_plants_unsupported_by_a_scenario_are_skipped_unless_specified(call, undrawn):
    arguments = ("side_slope_5", "--controllers", "pd", "--no-rrd", "--set", "duration_s=1", "--out", "cmp")
    status, out, err = call("compare", *arguments)
    assert status == 0
    assert "mujoco" in out
    assert err.startswith("bicycle is omitted: side_slope_5: terrain.kind: the bicycle plant supports only flat ground")
    assert err.count("\n") == 1
    status, _, err = call("compare", *arguments, "--plants", "bicycle,mujoco")
    assert status == 2
    assert "omitted" not in err
    assert "the bicycle plant supports only flat ground" in err


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_comparison_results_equal_those_of_single_runs(call, undrawn, jobs):
    """The default number of processes is tested in tests/studies/sweep."""
    arguments = ("--controllers", "pd,pd_t1fnn", "--plants", "mujoco", "--seeds", "2", "--no-rrd", "--jobs", jobs)
    assert call("compare", "circle", *arguments, "--set", "duration_s=1", "--out", "cmp")[0] == 0
    rows = json.loads(Path("cmp/comparison.json").read_text())
    cases = [("mujoco", controller, seed) for controller in ("pd", "pd_t1fnn") for seed in (1, 2)]
    assert [(row["plant"], row["controller"], row["seed"]) for row in rows] == cases
    assert len({row["lateral_mse"] for row in rows}) == 4
    folders = {path.name for path in Path("cmp").iterdir() if path.is_dir()}
    assert folders == {"rows", *(f"{plant}-{controller}-s{seed}" for plant, controller, seed in cases)}
    alone = ("--set", "seed=2", "--set", "controller.kind=pd", "--set", "duration_s=1", "--no-rrd", "--out", "alone")
    assert call("run", "circle", *alone)[0] == 0
    assert Path("alone/signals.parquet").read_bytes() == Path("cmp/mujoco-pd-s2/signals.parquet").read_bytes()


def children(parent):
    """Return the process ids of the running worker processes of `parent`."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
            command = (entry / "cmdline").read_text()
        except OSError:
            continue
        if fields[1] == str(parent) and fields[0] != "Z" and "spawn_main" in command:
            found.append(int(entry.name))
    return found


def alive(pids):
    return [pid for pid in pids if Path(f"/proc/{pid}").exists()]


def until(condition, seconds):
    """Wait up to `seconds` for `condition` and return its value."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.1)
    return condition()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize("number", [pytest.param(signal.SIGTERM, marks=pytest.mark.slow), signal.SIGINT])
def test_interrupted_comparison_leaves_no_process(number):
    """The runs would take days, and with few processors further runs are waiting."""
    arguments = ["--controllers", "pd", "--plants", "bicycle", "--seeds", "4", "--set", "duration_s=80000"]
    command = [sys.executable, "-m", "agrobot_mj", "compare", "circle", *arguments, "--out", "cmp"]
    Path("scratch").mkdir()
    environment = {**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[2]), "TMPDIR": "scratch"}
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, env=environment, start_new_session=True, **pipes) as process:
        workers = []
        try:
            begun = min(4, os.cpu_count() or 1)
            assert until(lambda: len(list(Path("scratch").rglob("run.rrd"))) == begun, 600)
            workers = children(process.pid)
            assert len(workers) == begun
            os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
            assert until(lambda: process.poll() is not None and not alive(workers), 300)
            assert process.returncode != 0
            assert list(Path("scratch").glob("agrobot-mj-*")) == []
        finally:
            process.kill()
            for pid in alive(workers):
                os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize(
    "arguments", [("compare", "circle", "x" * 50_000), ("run", "--" + "x" * 50_000), ("x" * 50_000,)]
)
def test_usage_error_shortens_long_arguments(call, arguments):
    status, _, said = call(*arguments)
    assert status == 2
    assert "xxx" in said
    assert len(said) < 5000


@pytest.mark.parametrize(
    ("value", "problem"),
    [("two", "a whole number, got 'two'"), ("1e3", "a whole number, got '1e3'"), ("0", "at least 1, got 0")],
)
def test_invalid_number_of_an_option_is_quoted_in_the_message(call, value, problem):
    status, _, said = call("compare", "circle", "--seeds", value)
    assert status == 2
    assert f"Invalid value for '--seeds': must be {problem}" in said


@pytest.mark.parametrize(
    ("arguments", "name", "meaning"),
    [
        (("run",), "argument 'SCENARIO'", "Name from `agrobot-mj list`"),
        (("limit", "circle"), "option '--key KEY'", "e.g. terrain.grade_deg"),
        (("risk", "circle"), "option '--until CONDITION'", "e.g. 'xte_rms > 0.3'"),
    ],
)
def test_error_for_a_missing_option_explains_the_option(call, arguments, name, meaning):
    status, _, said = call(*arguments)
    assert status == 2
    assert f"Missing {name}. " in said
    assert meaning in said
