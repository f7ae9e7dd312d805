"""examples/plugin_template, installed by pip, is found by its entry point, and its tests pass."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEMPLATE = ROOT / "examples" / "plugin_template"


def python(folder, *arguments, path=()):
    """Return the output of a successful Python process in a folder, with the folders `path` on its module path."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (ROOT, *path)))}
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_tests_of_an_installed_plugin_pass(tmp_path):
    pytest.importorskip("pip")
    copy = shutil.copytree(TEMPLATE, tmp_path / "copy", ignore=shutil.ignore_patterns("__pycache__"))
    options = ("--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--target", tmp_path / "site")
    python(tmp_path, "-m", "pip", "install", *options, copy)
    shutil.rmtree(copy / "my_parts")  # what is found is what is installed
    options = ("-p", "no:cacheprovider", "--rootdir", copy, "-c", os.devnull)
    said = python(tmp_path, "-m", "pytest", *options, copy / "tests", path=[tmp_path / "site"])
    assert "3 passed" in said


def test_kind_of_an_uninstalled_plugin_is_rejected(call):
    status, _, said = call("run", "circle", "--set", "guidance.kind=my_gains")
    assert (status, said.startswith("circle.toml: guidance.kind: unknown kind 'my_gains'")) == (2, True), said
