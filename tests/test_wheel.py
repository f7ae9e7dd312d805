"""Wheel installed outside the checkout: the package contains models and scenarios, and runs a scenario by name."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from processes import bare

ROOT = Path(__file__).parent.parent


def call(*command: str, cwd: Path, site: Path | None = None) -> str:
    """Return the standard output of a successful command. `site` precedes all other packages.

    Kernels run as plain Python, because their compilation would take longer than all other steps.
    """
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | {"NUMBA_DISABLE_JIT": "1"}
    if site is not None:
        environment["PYTHONPATH"] = str(site)
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    call(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), ".", cwd=ROOT)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the installed wheel only. The dependencies come from the test environment."""
    pytest.importorskip("pip")
    folder = tmp_path_factory.mktemp("site")
    options = ("--quiet", "--no-deps", "--no-index", "--target", str(folder))
    call(sys.executable, "-m", "pip", "install", *options, str(wheel), cwd=folder)
    return folder


def test_package_wheel_contains_every_model_and_scenario(wheel: Path):
    inside = set(zipfile.ZipFile(wheel).namelist())
    for folder in ("models", "scenarios"):
        files = [path for path in (ROOT / folder).rglob("*") if path.is_file()]
        assert files
        assert {f"agrobot_mj/{path.relative_to(ROOT)}" for path in files} <= inside
    assert "agrobot_mj/py.typed" in inside
    assert not [name for name in inside if name.startswith(("tests", "scripts", "docs"))]


def test_installed_package_lists_its_scenarios(site: Path, tmp_path: Path):
    origin = call(sys.executable, "-c", "import agrobot_mj; print(agrobot_mj.__file__)", cwd=tmp_path, site=site)
    assert Path(origin.strip()).is_relative_to(site)
    listed = bare(tmp_path, site / "bin" / "agrobot-mj", "list", PYTHONPATH=str(site)).stdout
    names = [line.split()[0] for line in listed.splitlines()]
    assert names == sorted(path.stem for path in (ROOT / "scenarios").glob("*.toml"))


def test_installed_package_runs_a_scenario_by_name(site: Path, tmp_path: Path):
    options = ("--set", "duration_s=0.5", "--set", "plant.settle_s=0.5", "--no-rrd", "--out", "here")
    done = bare(tmp_path, "-m", "agrobot_mj", "run", "figure_eight", *options, PYTHONPATH=str(site))
    assert done.returncode == 0, done.stderr
    written = {path.name for path in (tmp_path / "here").iterdir()}
    assert {"signals.parquet", "metrics.json", "scenario.toml"} <= written
