"""docs/plugins.md is true: its law runs from the command line and from Python, from a folder outside the package."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from processes import command, program

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")
LAW, SCRIPT = re.findall(r"```python\n(.*?)```", TEXT, re.S)
(COMMANDS,) = re.findall(r"```\n(agrobot-mj.*?)```", TEXT, re.S)
(ENTRY,) = re.findall(r"```toml\n(.*?)```", TEXT, re.S)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "my_law.py").write_text(LAW, encoding="utf-8")
    return folder


def python(folder, *arguments, **more):
    """A Python process in a folder; warnings of the users' kind are errors."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *more.get("path", [])])}
    words = [sys.executable, "-W", "error::UserWarning", *arguments]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_the_commands_of_the_page_work_and_the_run_repeats(folder):
    for line in COMMANDS.splitlines():
        short = ["--set", "duration_s=2", "--no-rrd"] if line.split()[1] == "run" else []
        done = command(folder, *line.split()[1:], *short)
        assert (done.returncode, done.stderr) == (0, ""), line
    guidance = tomllib.loads((folder / "mine" / "scenario.toml").read_text())["guidance"]
    assert guidance == {"kind": "my_law", "ahead_m": 2.5}
    for name in ("signals.parquet", "scenario.toml"):
        assert (folder / "mine" / name).read_bytes() == (folder / "again" / name).read_bytes()


def test_without_the_plugin_the_message_names_the_option(folder):
    (folder / "mine.toml").write_text('[guidance]\nkind = "my_law"\n')
    done = command(folder, "run", "mine.toml")
    assert done.returncode == 2
    assert done.stderr.startswith("mine.toml: guidance.kind: unknown kind 'my_law'")
    assert "--plugin FILE.py" in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_script_of_the_page_works(folder):
    done = program(folder, SCRIPT)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", "completed\n")


def test_an_installed_plugin_needs_no_option(folder):
    """The distribution is a folder with metadata, as an installer leaves it."""
    site = folder / "site"
    (site / "my_package").mkdir(parents=True)
    (site / "my_package" / "__init__.py").write_text("")
    (site / "my_package" / "my_law.py").write_text(LAW, encoding="utf-8")
    ((group, names),) = tomllib.loads(ENTRY)["project"]["entry-points"].items()
    metadata = site / "my_package-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n")
    lines = [f"[{group}]", *(f"{name} = {value}" for name, value in names.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    done = python(folder, "-m", "agrobot_mj", "list", "--kinds", path=[str(site)])
    assert (done.returncode, done.stderr) == (0, "")
    assert re.search(r"^guidance +my_law +Pure pursuit", done.stdout, re.M)


@pytest.mark.slow  # workers of a sweep know their plugin by default: tests/studies/sweep
def test_a_comparison_in_several_processes_knows_the_plugin(folder):
    options = ["--plugin", "my_law.py", "--set", "guidance.kind=my_law", "--set", "duration_s=1", "--no-rrd"]
    cases = ["--controllers", "pd", "--plants", "bicycle", "--seeds", "2", "--out", "cmp"]
    done = python(folder, "-m", "agrobot_mj", "compare", "straight_line", *options, *cases)
    assert (done.returncode, done.stderr) == (0, "")
