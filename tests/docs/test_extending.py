"""docs/extending.md is true: a new terrain and a new fault take one file and one line in the union each."""

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

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
PYTHON = dict(re.findall(r"^`(agrobot_mj/[\w/]+\.py)`[^\n]*:\n\n```python\n(.*?)```", TEXT, re.M | re.S))
(SCENARIO,) = re.findall(r"```toml\n(.*?)```", TEXT, re.S)


def add_lines(file: Path, block: str) -> None:
    """An import goes before the first of the package's, a name before the second of the union."""
    lines = file.read_text(encoding="utf-8").splitlines()
    for line in block.splitlines():
        mark = "    | " if line.startswith("    | ") else "from agrobot_mj."
        lines.insert(next(k for k, old in enumerate(lines) if old.startswith(mark)), line)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of what the software consists of, changed as the page says."""
    folder = tmp_path_factory.mktemp("checkout")
    for name in ("agrobot_mj", "scenarios", "models"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for path, block in PYTHON.items():
        file = folder / path
        if file.exists():
            add_lines(file, block)
        else:
            file.write_text(block, encoding="utf-8")
    (folder / "hill.toml").write_text(SCENARIO, encoding="utf-8")
    return folder


def call(folder, *arguments):
    """The command in that checkout; without compiled kernels, which would take longer than the run."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-m", "agrobot_mj", *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_a_new_terrain_and_a_new_fault_take_one_file_and_one_line_in_the_union_each():
    files = [path for path in PYTHON if not path.endswith("__init__.py")]
    assert sorted(path.split("/")[1] for path in files) == ["faults", "terrain"]
    assert not any((ROOT / path).exists() for path in files), "pick kinds that are not there yet"
    for family in ("faults", "terrain"):
        imported, named = PYTHON[f"agrobot_mj/{family}/__init__.py"].splitlines()
        assert imported.startswith(f"from agrobot_mj.{family}.")
        assert named == "    | " + imported.split()[-1]


def test_the_new_kinds_run_and_do_what_they_say(checkout):
    done = call(checkout, "run", "hill.toml", "--no-rrd", "--out", "out", "--set", "plant.settle_s=0.5")
    assert (done.returncode, done.stderr) == (0, "")
    assert "completed" in done.stdout
    scenario = tomllib.loads((checkout / "out" / "scenario.toml").read_text(encoding="utf-8"))
    assert (scenario["terrain"]["kind"], scenario["terrain"]["height_m"]) == ("dome", 2.0)
    assert (scenario["fault"][0]["kind"], scenario["fault"][0]["east_m"]) == ("gnss_shift", 0.25)
    signals = pq.read_table(checkout / "out" / "signals.parquet").to_pydict()
    assert signals["z_ref"][0] == pytest.approx(2.0, abs=0.01), "the reference runs over the top"
    assert signals["z"][0] == pytest.approx(2.0 + 0.55, abs=0.05), "and the tractor stands on it"
    off = np.array(signals["gnss_x"]) - np.array(signals["rear_x"])
    assert off[20:].mean() - off[:20].mean() == pytest.approx(0.25, abs=0.03)
    assert signals["faults_active"] == 20 * [0.0] + 20 * [1.0]


def test_the_new_kinds_are_known_by_name(checkout):
    done = call(checkout, "run", "hill.toml", "--set", "terrain.kind=dom", "--set", "fault.0.kind=gnss_shif")
    assert done.returncode == 2
    assert "terrain.kind: unknown kind 'dom'; did you mean 'dome'?" in done.stderr
    assert "fault[0].kind: unknown kind 'gnss_shif'; did you mean 'gnss_shift'?" in done.stderr
