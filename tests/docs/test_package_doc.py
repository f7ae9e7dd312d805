"""Package of docs/extending.md: with the printed files and installed by pip, it adds a command, a kind and a page."""

import os
import re
import shutil
import subprocess
import sys
from math import atan, degrees
from pathlib import Path

import pytest
from processes import bare

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^`my-terraces/([\w./]+)`:\n\n```\w+\n(.*?)```", TEXT, re.M | re.S))
LIST = """
import sys
from agrobot_mj import cli
sys.argv = ["agrobot-mj", "list"]
try:
    cli.main()
except SystemExit:
    pass
assert "my_terraces.commands" in sys.modules
print(*{"numpy", "numba", "mujoco", "agrobot_mj.scenario.schema"} & set(sys.modules), file=sys.stderr)
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """Return the folder of the example package, which is installed into the neighbouring folder `site`."""
    pytest.importorskip("pip")
    folder = tmp_path_factory.mktemp("package") / "my-terraces"
    for name, content in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content, encoding="utf-8")
    copy = shutil.copytree(folder, folder.parent / "copy")
    options = ("--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--target", folder.parent / "site")
    python(folder.parent, "-m", "pip", "install", *options, copy)
    shutil.rmtree(folder / "my_terraces")  # what is found is what is installed
    return folder


def path(folder):
    """Return the module search path with the installed package."""
    return os.pathsep.join(map(str, (ROOT, folder.parent / "site", folder / "site")))


def python(folder, *arguments):
    """Return stdout and stderr of a successful Python process with the installed package."""
    environment = {**os.environ, "PYTHONPATH": path(folder), "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout, done.stderr


def agrobot_mj(folder, *arguments):
    """Return the output of a successful command with the installed package."""
    done = bare(folder, "-m", "agrobot_mj", *arguments, PYTHONPATH=path(folder))
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_command_of_the_example_package_reports_the_terrain_grade(package):
    said = agrobot_mj(package, "grades", "circle", "--set", "terrain.kind=terraces")
    (grade,) = re.findall(r"^circle: at most ([\d.]+) deg$", said, re.M)
    assert 0.8 * degrees(atan(0.5 / 5)) < float(grade) < degrees(atan(0.5 / 5))


def test_list_shows_command_and_component_kind_of_the_example_package(package):
    assert "grades" in agrobot_mj(package, "--help")
    assert re.search(r"^terrain +terraces +Level strips", agrobot_mj(package, "list", "--kinds"), re.M)


def test_tests_of_the_example_package_pass(package):
    said, _ = python(package, "-m", "pytest", "-p", "no:cacheprovider", "--rootdir", package, "-c", os.devnull, "tests")
    assert "2 passed" in said


def test_list_command_of_a_package_imports_neither_numpy_nor_schema(package):
    assert python(package, "-c", LIST)[1].split() == []
