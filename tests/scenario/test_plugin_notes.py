"""Results with plugin kinds name the plugin file, in commands and in messages; errors start with the plugin."""

import re
from pathlib import Path
from shlex import split

import pytest
from processes import command

LAW = """
from typing import Literal
from agrobot_mj.control import GuidanceLaw
from agrobot_mj.core.signals import Command

class Straight(GuidanceLaw):
    kind: Literal["straight_on"] = "straight_on"

    def update(self, state, situation, dt):
        return state, Command(steer=0.0, speed=1.1)

class Forgetful(Straight):
    kind: Literal["forgetful"] = "forgetful"

    def update(self, state, situation, dt):
        return self.grown(state), Command(steer=0.0, speed=1.1)

    def grown(self, state):
        return state + 1.0

class Exhausted(Straight):
    kind: Literal["exhausted"] = "exhausted"

    def update(self, state, situation, dt):
        return next(iter(())), Command(steer=0.0, speed=1.1)
"""
SWEEP = """
base = "drive.toml"
seeds = 2
[axes]
"guidance.kind" = ["straight_on", "lqr"]
"path.speed_m_s" = [1.0, 1.3]
"""
DRIVE = 'duration_s = 1.5\n[plant]\nkind = "bicycle"\n[path]\nkind = "line"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("with blank")
    for name, text in (("own.py", LAW), ("laws.toml", SWEEP), ("drive.toml", DRIVE)):
        (folder / name).write_text(text, encoding="utf-8")
    done = command(folder, "sweep", "laws.toml", "--plugin", "own.py", "--jobs", "1", "--out", "swept")
    assert done.returncode == 0, done.stderr
    keys = ("--set", "guidance.kind=straight_on", "--no-rrd", "--out", "driven")
    assert command(folder, "run", "drive.toml", "--plugin", "own.py", *keys).returncode == 0
    return folder


def test_report_command_without_the_plugin_names_option_and_file(folder):
    done = command(folder, "report", "swept")
    assert done.returncode == 2
    first, last = done.stderr.splitlines()
    assert "unknown kind 'straight_on'" in first
    assert last == f"swept/sweep.toml: the scenario was run with plugins; add --plugin '{folder / 'own.py'}'"


def test_command_shown_for_the_worst_run_of_a_report_can_be_executed(folder):
    assert command(folder, "report", "swept", "--plugin", "own.py").returncode == 0
    page = (folder / "swept" / "report.html").read_text(encoding="utf-8")
    shown = re.search(r"<pre>(<span>agrobot-mj run.*?)</pre>", page, re.DOTALL)[1]
    line = re.sub(r"<[^>]+>", "", shown).replace("&#x27;", "'").replace("&quot;", '"')
    assert "--plugin" in line
    assert command(folder, *split(line)[1:], "--no-rrd").returncode == 0


def test_run_command_without_the_plugin_names_option_and_file(folder):
    done = command(folder, "run", "driven/scenario.toml", "--no-rrd")
    assert done.returncode == 2
    options = re.search(r": the scenario was run with plugins; add (.*)", done.stderr)[1]
    again = command(folder, "run", "driven/scenario.toml", "--no-rrd", "--out", "again", *split(options))
    assert again.returncode == 0, again.stderr
    assert (folder / "again/signals.parquet").read_bytes() == (folder / "driven/signals.parquet").read_bytes()


def test_error_for_a_misspelt_kind_also_names_the_plugin_option(folder):
    done = command(folder, "run", "drive.toml", "--set", "guidance.kind=lqrs")
    assert "unknown kind 'lqrs'; did you mean 'lqr'?" in done.stderr
    assert "--plugin FILE.py" in done.stderr


def test_error_in_a_plugin_begins_with_its_file_name(folder):
    done = command(folder, "run", "drive.toml", "--plugin", "own.py", "--set", "guidance.kind=forgetful", "--no-rrd")
    assert done.returncode == 1
    lines = done.stderr.splitlines()
    start = lines.index("Traceback (most recent call last):")
    assert lines[start + 1].strip() == f'File "{folder / "own.py"}", line 16, in update'
    assert lines[-1].startswith("TypeError: unsupported operand")
    assert len(lines) - start < 12
    assert not list(Path(folder).glob("runs/*/signals.parquet"))


def test_stop_iteration_in_a_plugin_begins_with_its_file_name(folder):
    done = command(folder, "run", "drive.toml", "--plugin", "own.py", "--set", "guidance.kind=exhausted", "--no-rrd")
    lines = done.stderr.splitlines()
    start = lines.index("Traceback (most recent call last):")
    assert done.returncode == 1
    assert lines[start + 1].strip() == f'File "{folder / "own.py"}", line 25, in update'
    assert lines[-1] == "StopIteration"


def test_error_of_a_failed_comparison_run_names_the_line_of_the_plugin(folder):
    keys = ("--guidance", "forgetful", "--plants", "bicycle", "--no-rrd", "--jobs", "1")
    done = command(folder, "compare", "drive.toml", "--plugin", "own.py", *keys)
    assert done.returncode == 1
    assert "'float' (own.py, line 19))" in done.stderr
