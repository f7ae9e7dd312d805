"""Examples of docs/extending.md: a new member of each family needs one file and a few further lines."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from processes import bare, program

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
PYTHON = dict(
    re.findall(r"^`((?:agrobot_mj|tests)/[\w/]+\.py)`[^\n]*:\n\n```(?:python|text)\n(.*?)```", TEXT, re.M | re.S)
)
(SCENARIO,) = re.findall(r"## Use the new parts\n\n```toml\n(.*?)```", TEXT, re.S)
FAMILIES = {"terrain", "faults", "control", "tyres", "paths", "sensors", "metrics"}
NEW = "carrot or dome or brush or racetrack or gnss_shift or accelerometer or comfort"
"""Names of the new members, which are part of the names of their contract tests."""
LISTS = (
    *("tests/test_architecture.py", "tests/test_writing.py", "tests/simulation/test_columns.py"),
    *("tests/docs/test_columns_doc.py", "tests/docs/test_models_doc.py", "tests/docs/test_scenarios_doc.py"),
)
"""Tests that check all members together."""
ANNOUNCED = {"test_models_doc.py::test_every_assumed_value_has_a_row_in_a_parameter_table"}
"""Tests that, as documented on the page, fail until the new kinds are described."""
SHORT_START = ("--set", "plant.settle_s=0.1", "--set", "physics=fast")
"""Options for fewer physics steps, because the steps run as plain Python."""
TESTED = """
import runpy, sys, pytest
first, *words = sys.argv[1:]
if first:
    runpy.run_path(first, run_name="__main__")
sys.exit(pytest.main(words))
"""


def add_lines(file: Path, block: str) -> None:
    """Insert package imports before the first one in the file, and other lines after the preceding line of `block`."""
    lines = file.read_text(encoding="utf-8").splitlines()
    place = None
    for line in block.splitlines():
        if line in lines:
            place = lines.index(line)
        elif line.startswith("from agrobot_mj."):
            lines.insert(next(k for k, old in enumerate(lines) if old.startswith("from agrobot_mj.")), line)
        else:
            assert place is not None, f"{file}: nothing says where {line!r} goes"
            place += 1
            lines.insert(place, line)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """Return a copy of the source tree, changed as described on the page."""
    folder = tmp_path_factory.mktemp("checkout")
    for name in ("agrobot_mj", "scenarios", "models", "tests", "docs", "scripts", "examples"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("images"))
    for file in [file for file in ROOT.iterdir() if file.is_file()]:
        shutil.copy(file, folder)
    for path, block in PYTHON.items():
        file = folder / path
        if file.exists():
            add_lines(file, block)
        else:
            file.write_text(block, encoding="utf-8")
    (folder / "hill.toml").write_text(SCENARIO, encoding="utf-8")
    return folder


def call(folder, *arguments):
    """Run a command in the checkout without compiled kernels, because compilation would take longer than the run."""
    return bare(folder, "-m", "agrobot_mj", *arguments, PYTHONPATH=str(folder))


@pytest.fixture(scope="module")
def results(checkout):
    """Return the folder of a run of the page's scenario."""
    done = call(checkout, "run", "hill.toml", "--out", "out", *SHORT_START)
    assert done.returncode == 0, done.stderr
    assert all("starting" in line for line in done.stderr.splitlines()), "only progress on a busy machine"
    assert "completed" in done.stdout
    return checkout / "out"


def test_new_component_needs_one_file_and_few_lines_in_other_files():
    files = [path for path in PYTHON if not (ROOT / path).exists()]
    assert {path.split("/")[1] for path in files} == FAMILIES
    assert len(files) == len(FAMILIES), "pick kinds that are not there yet"
    for path, block in PYTHON.items():
        if path not in files:
            there = (ROOT / path).read_text(encoding="utf-8").splitlines()
            assert len([line for line in block.splitlines() if line not in there]) <= 3, path


def outcomes(folder, *arguments, compiled=False, first=""):
    """Return the failed and the passed tests of the checkout, as `file::test`. Kernels are compiled only if `compiled`.

    `first` is a script that runs before the tests, in the same process.
    """
    path = os.pathsep.join((str(folder), str(folder / "scripts")))
    words = ["-c", TESTED, first, "-rfp", "--tb=no", "-p", "no:cacheprovider", "-p", "no:xdist", *arguments]
    if compiled:
        environment = {**os.environ, "PYTHONPATH": path}
        python = [sys.executable, *words]
        done = subprocess.run(python, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    else:
        done = bare(folder, *words, PYTHONPATH=path)
    assert done.returncode in (0, 1), done.stdout[-4000:] + done.stderr
    assert " passed" in done.stdout, done.stderr
    return tuple(
        set(re.findall(rf"^{outcome} tests/(?:\w+/)*(\S+)", done.stdout, re.M)) for outcome in ("FAILED", "PASSED")
    )


@pytest.fixture(scope="module")
def contracts(checkout):
    """Return the failed and the passed tests of all members and of the new members, with a regenerated reference.

    Tests that simulate the law and the tyre are excluded.
    """
    files = (
        *LISTS,
        *(f"tests/{name}" for name in ("faults", "metrics", "paths", "sensors", "terrain/test_terrains.py")),
    )
    lists = " or ".join(Path(name).name for name in LISTS)
    return outcomes(checkout, *files, "-k", f"{lists} or ({NEW}) and not brush", first="scripts/make_reference.py")


def of_lists(tests):
    """Return the tests that check all members together."""
    names = {Path(name).name for name in LISTS}
    return {test for test in tests if test.partition("::")[0] in names}


def test_contract_tests_without_the_plugin_fail_only_as_documented(contracts):
    failed, passed = contracts
    assert of_lists(failed) == ANNOUNCED
    assert {test.partition("::")[0] for test in of_lists(passed)} == {Path(name).name for name in LISTS}


def test_contract_tests_of_the_new_components_pass(contracts):
    failed, passed = contracts
    assert failed - of_lists(failed) == set()
    assert len(passed - of_lists(passed)) >= 22


@pytest.mark.slow
def test_contract_tests_of_the_example_law_pass(checkout):
    """By default, `test_example_law_follows_every_kind_of_path` simulates the law on every path."""
    failed, passed = outcomes(checkout, "tests/control", "-k", "carrot", compiled=True)
    assert failed == set()
    assert len(passed) >= 1


@pytest.mark.slow
def test_documented_tests_of_tyre_columns_and_plots_pass(checkout):
    folders = ("extensions/bench", "core", "plants", "scenario", "simulation", "tyres")
    failed, passed = outcomes(checkout, *(f"tests/{name}" for name in folders), "-k", "brush", compiled=True)
    assert failed == set()
    assert len(passed) > 25
    assert outcomes(checkout, "tests/recording/test_recording_signals.py", compiled=True)[0] == set()


def test_resolved_scenario_contains_the_plugin_kinds_of_the_example_page(results):
    scenario = tomllib.loads((results / "scenario.toml").read_text(encoding="utf-8"))
    assert (scenario["terrain"]["kind"], scenario["terrain"]["height_m"]) == ("dome", 2.0)
    assert (scenario["fault"][0]["kind"], scenario["fault"][0]["east_m"]) == ("gnss_shift", 0.25)
    assert (scenario["guidance"]["kind"], scenario["guidance"]["gain"]) == ("carrot", 1.0)
    assert (scenario["plant"]["tyre"]["kind"], scenario["path"]["kind"]) == ("brush", "racetrack")
    assert scenario["sensors"]["accelerometer"]["sigma_m_s2"] == 0.05


def test_example_components_work_as_described_on_the_page(results):
    table = pq.read_table(results / "signals.parquet")
    signals = {name: np.array(column, dtype=float) for name, column in table.to_pydict().items()}
    assert signals["z_ref"][0] == pytest.approx(2.0, abs=0.01), "the reference runs over the top"
    assert signals["z"][0] == pytest.approx(2.0 + 0.55, abs=0.05), "and the tractor stands on it"
    off = signals["gnss_x"] - signals["rear_x"]
    assert off[20:40].mean() - off[:20].mean() == pytest.approx(0.25, abs=0.03)
    assert signals["faults_active"].tolist() == 20 * [0.0] + 20 * [1.0] + 40 * [0.0]
    assert 0 < np.abs(signals["accelerometer"] - signals["lateral_acceleration"]).max() < 5 * 0.05
    assert signals["steer_ref"] == pytest.approx(signals["bearing"], abs=1e-12)
    assert signals["lateral_acceleration"] == pytest.approx(signals["speed"] * signals["yaw_rate"])
    assert signals["speed"][-1] > 0.5
    used = np.hypot(signals["fx_rl"], signals["fy_rl"]) / signals["load_rl"]
    assert 0 < used.max() < 0.7 + 0.06


def test_columns_and_metrics_of_the_example_have_descriptions(results):
    schema = pq.read_schema(results / "signals.parquet")
    assert schema.field("lateral_acceleration").metadata[b"unit"] == b"m/s2"
    assert schema.field("bearing").metadata[b"description"].startswith(b"bearing of the carrot")
    metrics = json.loads((results / "metrics.json").read_text(encoding="utf-8"))
    assert 0 < metrics["lateral_acceleration_rms"] < 1


def test_recording_contains_the_plots_of_the_example(results):
    from rerun.chunk import RrdReader

    plots = {chunk.entity_path for chunk in RrdReader(str(results / "run.rrd")).stream().to_chunks()}
    assert {"/plots/yaw_rate/lateral_acceleration", "/plots/reported/bearing", "/plots/reported/accelerometer"} <= plots


DRIVE = """
import json, sys
from agrobot_mj import load_scenario, register, run
from carrot import Carrot

register(Carrot)
found, whole, plants = {}, sys.argv[1] == "whole", ("bicycle", "mujoco")
for k, source in enumerate(("figure_eight", "circle", "straight_line", "lane_change", "slalom", "one_hectare")):
    for plant in plants if whole else plants[k % 2 :][:1]:
        seconds = (150.0 if source == "one_hectare" else 60.0) if whole else 10.0
        keys = {"guidance.kind": "carrot", "plant.kind": plant, "terrain.kind": "flat", "supervisor.enabled": False}
        log = run(load_scenario(source, {**keys, "duration_s": seconds}))
        found[f"{source} {plant}"] = [log.outcome, log.metrics["progress"], log.metrics["xte_abs_p95"]]
print(json.dumps(found))
"""


@pytest.mark.parametrize(("length", "runs"), [("short", 6), pytest.param("whole", 12, marks=pytest.mark.slow)])
def test_example_law_follows_every_kind_of_path(tmp_path, length, runs):
    """Simulate the law of the page on flat ground without supervisor; in slow tests for a minute on both plants."""
    (tmp_path / "carrot.py").write_text(PYTHON["agrobot_mj/control/carrot.py"], encoding="utf-8")
    done = program(tmp_path, DRIVE, length)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found) == runs
    for name, (outcome, progress, error) in found.items():
        assert outcome == "completed", (name, outcome, progress)
        assert progress > 0.9, name
        assert error < 1.0, name


def test_tractor_with_example_law_moves_off_if_faults_are_removed(checkout):
    changes = ("--set", "fault=[]", "--set", "duration_s=2.5", *SHORT_START)
    done = call(checkout, "run", "hill.toml", *changes, "--no-rrd", "--out", "still")
    assert done.returncode == 0, done.stderr
    signals = pq.read_table(checkout / "still" / "signals.parquet")
    assert signals["speed_ref"].to_numpy()[0] == 0.3
    assert signals["speed"].to_numpy()[-1] > 0.3


def test_kinds_of_the_example_can_be_selected_by_name(checkout):
    wrong = {"terrain.kind": "dom", "fault.0.kind": "gnss_shif", "guidance.kind": "carot", "plant.tyre.kind": "brussh"}
    done = call(
        checkout, "run", "hill.toml", *(part for key, kind in wrong.items() for part in ("--set", f"{key}={kind}"))
    )
    assert done.returncode == 2
    assert "terrain.kind: unknown kind 'dom'; did you mean 'dome'?" in done.stderr
    assert "fault[0].kind: unknown kind 'gnss_shif'; did you mean 'gnss_shift'?" in done.stderr
    assert "guidance.kind: unknown kind 'carot'; did you mean 'carrot'?" in done.stderr
    assert "plant.tyre.kind: unknown kind 'brussh'; did you mean 'brush'?" in done.stderr
