"""Each extension can be removed with its folder, tests and pages. All other parts work, with fewer commands."""

import os
import shutil
import subprocess
import sys
from importlib.metadata import entry_points
from importlib.util import cache_from_source
from pathlib import Path

import pytest
from processes import bare

from agrobot_mj.cli.panels import command_name

ROOT = Path(__file__).parents[1]
FOLDERS = ("agrobot_mj", "tests", "docs")  # Folders that have one `extensions` each
NAMES = sorted(path.parent.name for path in (ROOT / "agrobot_mj" / "extensions").glob("*/__init__.py"))
EVERY_MODULE = """
import pkgutil, sys, agrobot_mj
for found in pkgutil.walk_packages(agrobot_mj.__path__, "agrobot_mj."):
    if not found.name.endswith("__main__"):
        try:
            __import__(found.name)
        except ImportError as error:  # a library of an extra
            assert not str(error.name).startswith("agrobot_mj"), error
assert agrobot_mj.__file__.startswith(PLACE), agrobot_mj.__file__
"""
EVERY_COMMAND = """
import sys
from agrobot_mj.cli import main
from agrobot_mj.cli.app import COMMANDS
PLACE = sys.argv[1]
for words in (["--help"], sys.argv[2:]):
    sys.argv = ["agrobot-mj", *words]
    try:
        main()
    except SystemExit as leaving:
        assert not leaving.code, words
print("commands:", *COMMANDS, sep=chr(10))
"""


def copy(source, target):
    """Copy a file with its time and, for a module, its bytecode, which otherwise would be compiled again."""
    pairs = [(source, target)]
    if source.suffix == ".py":
        pairs.append(tuple(Path(cache_from_source(path)) for path in pairs[0]))
    for old, new in pairs:
        if old.is_file():
            new.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(old, new)


def copied_without(names, place, *folders):
    """Copy all files under version control, or the files in some folders, except the files of some extensions."""
    listed = subprocess.run(["git", "ls-files", "-z", *folders], cwd=ROOT, capture_output=True, check=True)
    gone = [(folder, "extensions", name) for folder in FOLDERS for name in names]
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (file := ROOT / name).is_file() and Path(name).parts[:3] not in gone:
            copy(file, place / name)
    return place


def called(place, *command):
    """Run a Python command in a copy, with the package of the copy."""
    environment = {**os.environ, "PYTHONPATH": str(place)}
    ran = subprocess.run(
        [sys.executable, *map(str, command)], cwd=place, env=environment, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout


def commands(names):
    """Return the commands of the extensions with the given names."""
    entries = entry_points(group="agrobot_mj.commands")
    return {
        command_name(function)
        for entry in entries
        if entry.module.split(".")[:2] == ["agrobot_mj", "extensions"] and entry.module.split(".")[2] in names
        for function in entry.load()
    }


@pytest.mark.parametrize("names", [*([name] for name in NAMES), NAMES], ids=" ".join)
def test_package_works_after_removal_of_any_extension(names, tmp_path):
    place = copied_without(names, tmp_path / "copy", "agrobot_mj", "models", "scenarios")
    short = ("--set", "duration_s=0.2", "--set", "plant.kind=bicycle", "--no-rrd", "--out", tmp_path / "out")
    code = EVERY_COMMAND + EVERY_MODULE
    done = bare(place, "-c", code, place, "run", "circle", *short, PYTHONPATH=str(place))
    assert done.returncode == 0, done.stdout + done.stderr
    shown = set(done.stdout.rpartition("commands:\n")[2].splitlines())
    assert shown >= commands(set(NAMES) - set(names))
    assert not shown & commands(names)
    assert (tmp_path / "out" / "metrics.json").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("names", [*([name] for name in NAMES), NAMES], ids=" ".join)
def test_checks_and_tests_pass_after_removal_of_any_extension(names, tmp_path):
    place = copied_without(names, tmp_path / "copy")
    subprocess.run(["git", "init", "-q"], cwd=place, check=True)
    subprocess.run(["git", "add", "-A"], cwd=place, check=True)
    called(place, "-m", "ruff", "check", ".")
    called(place, "-m", "ruff", "format", "--check", ".")
    called(place, "-m", "mypy")
    called(place, "scripts/check_lock.py")
    called(place, "-m", "pytest", "-m", "not slow", "-n", "2", "--deselect", "tests/test_extensions.py")
