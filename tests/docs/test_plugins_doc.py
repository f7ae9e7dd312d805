"""docs/plugins.md: its law, tyre, sensor and metric run from a folder outside the package."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from processes import bare, command, program
from removed import needs_all
from test_extending import PYTHON
from told import without_progress

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")
LAW, INTEGRAL, SCRIPT = re.findall(r"```python\n(.*?)```", TEXT, re.S)
COMMANDS, OTHERS = re.findall(r"```\n(agrobot-mj.*?)```", TEXT, re.S)
FAULT = "fault=[{kind = 'steering_pot_bias', bias_deg = 4}]"
(ENTRY,) = re.findall(r"```toml\n(.*?)```", TEXT, re.S)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "my_law.py").write_text(LAW, encoding="utf-8")
    for path, block in PYTHON.items():
        if (name := Path(path).name) in re.findall(r"`(\w+\.py)`", TEXT):
            (folder / name).write_text(block, encoding="utf-8")
    return folder


def python(folder, *arguments, path=(), separate=False):
    """Run Python in a folder, where a UserWarning is an error. With `separate`, the process has compiled kernels."""
    variables = {"PYTHONPATH": os.pathsep.join([str(ROOT), *map(str, path)])}
    if not separate:
        return bare(folder, *arguments, **variables)
    words, environment = [sys.executable, "-W", "error::UserWarning", *arguments], os.environ | variables
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_commands_of_the_page_run_and_give_repeatable_results(folder):
    for line in COMMANDS.splitlines():
        short = ["--set", "duration_s=2", "--no-rrd"] if line.split()[1] == "run" else []
        done = command(folder, *line.split()[1:], *short)
        assert (done.returncode, without_progress(done.stderr)) == (0, ""), line
    guidance = tomllib.loads((folder / "mine" / "scenario.toml").read_text())["guidance"]
    assert guidance == {"kind": "my_law", "ahead_m": 2.5}
    for name in ("signals.parquet", "scenario.toml"):
        assert (folder / "mine" / name).read_bytes() == (folder / "again" / name).read_bytes()


@needs_all
def test_example_plugins_of_a_tyre_a_sensor_and_a_metric_can_be_run(folder):
    """The run with the page's tyre has no compiled kernels, because their compilation would take longer."""
    for line in OTHERS.splitlines():
        driven = line.split()[1] == "run"
        short = ["--set", "duration_s=1", "--set", "plant.settle_s=0.1"] if driven else []
        words = [*line.split()[1:], *short]
        plain = driven and "brush" in line
        done = python(folder, "-m", "agrobot_mj", *words) if plain else command(folder, *words)
        assert (done.returncode, done.stderr) == (0, ""), line
    assert (folder / "runs" / "rig-brush" / "curves.parquet").is_file()
    signals = {name: pq.read_table(folder / f"mine-{name}" / "signals.parquet") for name in ("brush", "accelerometer")}
    load, aside = (signals["brush"].column(name).to_numpy() for name in ("load_fl", "fy_fl"))
    assert 0 < np.abs(aside / load).max() < 0.7 + 0.06
    assert signals["accelerometer"].schema.field("accelerometer").metadata[b"unit"] == b"m/s2"
    assert json.loads((folder / "mine-comfort" / "metrics.json").read_text())["lateral_acceleration_rms"] > 0
    assert "| lateral_acceleration_rms |" in _info(folder / "mine-comfort")
    assert "/plots/reported/accelerometer" in {chunk.entity_path for chunk in _chunks(folder / "mine-accelerometer")}


def _chunks(run):
    from rerun.chunk import RrdReader

    return RrdReader(str(run / "run.rrd")).stream().to_chunks()


def _info(run):
    """Return the text of a recording."""
    return " ".join(str(chunk.to_record_batch().to_pydict()) for chunk in _chunks(run) if chunk.entity_path == "/info")


def test_error_for_a_missing_plugin_names_the_plugin_option(folder):
    (folder / "mine.toml").write_text('[guidance]\nkind = "my_law"\n')
    done = command(folder, "run", "mine.toml")
    assert done.returncode == 2
    assert done.stderr.startswith("mine.toml: guidance.kind: unknown kind 'my_law'")
    assert "--plugin FILE.py" in done.stderr
    assert done.stderr.count("\n") == 1


def test_integral_law_has_smaller_offset_than_law_without_integral(folder):
    (folder / "integral.py").write_text(f"{LAW}\n\n{INTEGRAL}", encoding="utf-8")
    steady = ("--set", "plant.kind=bicycle", "--set", "duration_s=90", "--set", FAULT)
    found = {}
    for kind in ("my_law", "my_integral"):
        words = ("run", "straight_line", "--plugin", "integral.py", "--set", f"guidance.kind={kind}", *steady)
        done = command(folder, *words, "--no-rrd", "--out", kind)
        assert done.returncode == 0, done.stderr
        rows = pq.read_table(folder / kind / "signals.parquet")
        found[kind] = abs(np.mean(rows["e_lateral"].to_numpy()[-200:]))
    assert found["my_law"] > 0.03
    assert found["my_integral"] < 0.5 * found["my_law"]


def test_python_script_shown_on_the_page_runs(folder):
    done = program(folder, SCRIPT)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", "completed\n")


def installed(site, law):
    """Write a distribution of the module `my_law` with its metadata, as an installer does. Return the folder."""
    (site / "my_package").mkdir(parents=True)
    (site / "my_package" / "__init__.py").write_text("")
    (site / "my_package" / "my_law.py").write_text(law, encoding="utf-8")
    ((group, names),) = tomllib.loads(ENTRY)["project"]["entry-points"].items()
    metadata = site / "my_package-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n")
    lines = [f"[{group}]", *(f"{name} = {value}" for name, value in names.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return site


WORKERS = """
from agrobot_mj.scenario.reference import families
from agrobot_mj.studies.engine.workers import pool_map
def known(kind):
    return kind in families()["guidance"]
if __name__ == "__main__":
    print(*(found for _, found in pool_map(known, ["my_law", "your_law"], 2)))
"""


def test_installed_plugin_needs_no_option_even_in_worker_processes(folder):
    site = installed(folder / "site", LAW)
    done = python(folder, "-m", "agrobot_mj", "list", "--kinds", path=[site])
    assert (done.returncode, done.stderr) == (0, "")
    assert re.search(r"^guidance +my_law +Pure pursuit", done.stdout, re.M)
    (folder / "workers.py").write_text(WORKERS, encoding="utf-8")
    done = python(folder, "workers.py", path=[site], separate=True)
    assert (done.returncode, sorted(done.stdout.split())) == (0, ["False", "True"]), done.stderr


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("import no_such_thing", "ModuleNotFoundError: No module named 'no_such_thing'"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        (LAW.replace("my_law", "lqr"), "register: guidance.kind 'lqr' already exists; choose another"),
    ],
)
def test_error_names_a_broken_installed_plugin(tmp_path, law, message):
    done = python(tmp_path, "-m", "agrobot_mj", "run", "straight_line", path=[installed(tmp_path / "site", law)])
    assert (done.returncode, done.stderr) == (2, f"plugin my_law of my-package: {message}\n")
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow  # workers of a sweep know their plugin by default: tests/studies/sweep
def test_parallel_comparison_uses_the_plugin(folder):
    options = ["--plugin", "my_law.py", "--set", "guidance.kind=my_law", "--set", "duration_s=1", "--no-rrd"]
    cases = ["--controllers", "pd", "--plants", "bicycle", "--seeds", "2", "--out", "cmp"]
    done = python(folder, "-m", "agrobot_mj", "compare", "straight_line", *options, *cases, separate=True)
    assert (done.returncode, without_progress(done.stderr)) == (0, "")
