"""All commands in the README and the pages of docs/ are valid.

The command line parses all commands. Their keys, scenarios, scripts, commands and extras must exist. Short commands are
run for half a second by default; with `pytest -m slow`, all other commands are run in the order of the page.
"""

import importlib.util
import json
import os
import re
import shlex
import sys
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pytest
import typer.main
from removed import REMOVED, needs_all
from similar import similar

from agrobot_mj import load_scenario, run
from agrobot_mj.cli import app, main
from agrobot_mj.cli.options import overrides
from agrobot_mj.cli.panels import split_command
from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.scenario.loading import scenario_files

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHELL = ("", "sh", "bash", "console", "shell")
OURS = "agrobot-mj"
OTHERS = {
    **dict.fromkeys(("dask", "ros2", "git", "uv", "apt", "sudo", "docker", "sbatch", "c++"), "a program of others"),
    "udp_law": "the law in C++; tests/docs/test_cookbook.py",
    **dict.fromkeys(("export", "source", ".", "mkdir", "cp"), "the shell's own"),
}
"""Programs that these tests do not run, with the reasons."""
QUICK = ("list", "explain", "init", "schema", "run")  # Verbs that are executed by default
UNATTENDED = {
    "view": "opens a viewer; tests/recording has its own tests",
    "snapshot": "needs a Vulkan driver; tests/recording/test_snapshot_renders.py",
    "link": "waits for a guidance program; tests/links",
    "play": "waits for a driver; tests/extensions/play",
    "ros2": "needs ROS 2; tests/links/test_ros2_node.py",
    "sweep importance": "takes minutes; tests/studies/sweep/test_importance.py",
    "report runs/sweep-importance": "reads the table of that sweep; tests/extensions/search",
    "validate": "takes minutes; tests/bench/manoeuvres",
    "field run": "takes minutes; tests/extensions/fields/test_field_run.py",
    "field compare": "reads a run of a link; tests/extensions/fields/test_recorded_work.py",
}
"""First words of commands that are only parsed, with the reasons."""
ELSEWHERE = {
    "docs/cookbook.md": "tests/docs/test_cookbook.py",
    "docs/plugins.md": "tests/docs/test_plugins_doc.py",
    "docs/studies.md": "tests/docs/test_studies_doc.py",
    "docs/third_party.md": "tests/test_third_party.py",
    "docs/extensions/fields/driving.md": "tests/extensions/fields/test_field_run.py",
    "docs/extensions/fields/fields.md": "tests/extensions/fields/test_fields_doc.py",
    "docs/extensions/links/gym.md": "tests/extensions/links/test_trainer.py",
    "docs/tutorial.md": "tests/docs/test_tutorial.py",
}
"""Pages whose commands are executed unchanged by another test."""
SHORT = {
    "run": "--set duration_s=30 --quiet",
    "compare": "--set duration_s=0.5 --no-rrd --quiet",
    "limit": "--set duration_s=0.5 --max-seeds 2 --jobs 1 --tolerance 20 --quiet",
    "risk": "--set duration_s=0.5 --particles 4 --repeats 2 --jobs 1 --quiet",
    "falsify": "--set duration_s=0.5 --budget 20 --seeds 1 --jobs 1 --quiet",
    "tune": "--budget 8 --seeds 1 --set duration_s=4 --quiet",
    "sweep": "--jobs 1 --quiet",
}
"""Options that are appended to a command to shorten it, by command."""
GLIMPSE = ("--set", "duration_s=0.5", "--quiet", "--no-rrd")  # What is appended to a run that is only to begin and end


class Printed(NamedTuple):
    """Command as printed on a page."""

    page: str
    folder: Path  # Folder of the tree in which it is to be run, after the block's `cd`
    words: list[str]

    @property
    def program(self):
        return Path(self.words[0]).name or self.words[0]

    @property
    def verb(self):
        return split_command(self.words[1:])[0] if self.program == OURS else ""

    @property
    def rest(self):
        """Words after the name of the command."""
        return split_command(self.words[1:])[1]

    def __str__(self):
        return f"{self.page}: {' '.join(self.words)}"


def known(word):
    name = Path(word).name
    return name in OTHERS or name in (OURS, "make", "cd", "pip") or re.fullmatch(r"python[\d.]*", name)


def commands():
    """Yield the commands of all pages in their order."""
    for page in PAGES:
        for language, block in re.findall(r"^```(\w*)[^\n]*\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M):
            folder = ROOT
            if language not in SHELL:
                continue
            for line in re.sub(r"\\\n\s*", "", block).splitlines():
                line = re.split(r" {2,}|\s*&$", line.removeprefix("$ "))[0]
                words = line.split() if "'" in line and '"' not in line else shlex.split(line, comments=True)
                if not words or not (language or known(words[0])):
                    continue
                yield Printed(str(page.relative_to(ROOT)), folder, words)
                folder = folder / words[1] if words[0] == "cd" else folder


ALL = list(commands())
CLI = typer.main.get_command(app)
IN_OURS = [c for c in ALL if c.program == OURS and (c.verb in CLI.commands or not REMOVED)]


@needs_all
def test_every_command_is_documented_and_every_page_has_commands():
    assert len(IN_OURS) > 40
    assert {command.verb for command in IN_OURS} >= {*CLI.commands} - {"schema"}
    assert {command.page for command in IN_OURS} >= {"README.md", *ELSEWHERE} - {"docs/extensions/links/gym.md"}


@pytest.mark.parametrize("command", IN_OURS, ids=str)
def test_documented_command_is_accepted_by_the_command_line(command):
    """The application itself parses the command, its options and the types of their values."""
    assert command.verb in CLI.commands
    context = CLI.commands[command.verb].make_context(command.verb, command.rest)
    assert context.args == []


PLUGINS = ("guidance.", "plant.tyre.kind", "sensors.accelerometer.")
"""Keys of components from plugins on the pages; tests/docs/test_plugins_doc.py simulates them."""


@pytest.mark.parametrize("command", [c for c in IN_OURS if "--set" in c.words or "--variant" in c.words], ids=str)
def test_keys_and_values_in_a_documented_command_are_valid(command):
    words, sets = command.words, overrides([b for a, b in pairwise(command.words) if a == "--set"])
    for text in [b for a, b in pairwise(words) if a == "--variant"]:
        sets |= overrides([part for part in text.partition(":")[2].split(",") if part.strip()])
    if "--plugin" in words or command.verb == "twin":
        sets = {key: value for key, value in sets.items() if not key.startswith(PLUGINS)}
    outside = {"link": {"guidance.kind": "agopengps"}, "ros2": {"guidance.kind": "cmd_vel"}}
    base = words[2] if words[2] in scenario_files() else "straight_line"
    load_scenario(base, outside.get(command.verb, {}) | sets)


@pytest.mark.parametrize("command", [c for c in ALL if c.program != OURS], ids=str)
def test_files_named_in_documented_commands_exist(command):
    words = command.words
    if command.program == "make":
        assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    elif command.program == "cd":
        assert (command.folder / words[1]).is_dir()
    elif command.program == "pip":
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        named = [name for text in re.findall(r"agrobot-mj\[([\w,]+)\]", " ".join(words)) for name in text.split(",")]
        assert set(named) <= set(extras["optional-dependencies"])
        assert named or "-e" in words or words[1] == "install"
    elif command.program.startswith("python") and words[1] == "-m":
        assert words[2] == "venv" or importlib.util.find_spec(words[2])
    elif command.program.startswith("python"):
        text = (command.folder / words[1]).read_text(encoding="utf-8")
        for option in [word for word in words[2:] if word.startswith("--") and word != "--set"]:
            assert f'"{option}"' in text, option
    else:
        assert command.program in OTHERS


def call(monkeypatch, folder, words):
    """Return the exit status of an `agrobot-mj` command in a folder."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", [OURS, *words])
    with pytest.raises(SystemExit) as leaving:
        main()
    return leaving.value.code


def test_documented_commands_run_for_half_a_second(tmp_path, monkeypatch, capsys):
    """The commands of a page run in their order, because later commands may read the files of earlier ones."""
    done = 0
    for command in IN_OURS:
        if command.verb not in QUICK or command.page in ELSEWHERE or "--plugin" in command.words:
            continue
        folder = tmp_path / command.page.replace("/", "-")
        folder.mkdir(exist_ok=True)
        words = [word for word in command.words[1:] if word != "--live"]
        status = call(monkeypatch, folder, [*words, *(GLIMPSE if command.verb == "run" else ())])
        assert (status, capsys.readouterr().err) == (0, ""), str(command)
        done += 1
    assert done >= 8


def supplied(folder):
    """Write the files that readers of a page must provide: field, sweep, law, and a recorded log with its map."""
    for page, language, file in (("studies", "toml", "mine.toml"), ("plugins", "python", "my_law.py")):
        text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
        (folder / file).write_text(re.search(rf"```{language}\n(.*?)```", text, re.S)[1], encoding="utf-8")
    for page in (ROOT / "docs" / "extensions").glob("logs/replay.md"):
        text = re.search(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.S)[1]
        (folder / "map.toml").write_text(text, encoding="utf-8")
    ring = [[6.72, 52.31], [6.722, 52.31], [6.721, 52.312]]
    (folder / "home.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}), encoding="utf-8")
    keys = {"duration_s": 60, "sensors.gyro.enabled": True, "path.speed_m_s": 2.0}
    log = run(similar(load_scenario("figure_eight", keys), 4200.0))
    places = [to_geodetic(Origin(51.0, 4.0), *p) for p in zip(log.column("gnss_x"), log.column("gnss_y"), strict=True)]
    columns = {
        "time_ms": 1e3 * log.column("t"),
        "was_deg": -1.2 - np.degrees(log.column("steer_measured")),
        "speed_kmh": 3.6 * log.column("speed_hat"),
        "gyro_z": np.degrees(log.column("gyro")),
        "heading": np.degrees(np.pi / 2 - log.column("yaw")) % 360.0,
        "lat": [place[0] for place in places],
        "lon": [place[1] for place in places],
        "fix": 2 * log.column("gnss_quality"),
    }
    pacsv.write_csv(pa.table(columns), folder / "field.csv")


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted({command.page for command in IN_OURS} - set(ELSEWHERE)))
def test_commands_of_a_page_run_in_order(page, tmp_path, monkeypatch, capsys):
    supplied(tmp_path)
    (tmp_path / "runs").mkdir()
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    if "run " not in " ".join(" ".join(c.words) for c in IN_OURS if c.page == page):
        words = ["run", "figure_eight", "--set", "duration_s=20", "--quiet", "--out", "runs/mine"]
        assert call(monkeypatch, tmp_path, words) == 0
    for command in IN_OURS:
        text = " ".join(command.words[1:])
        if command.page != page or text.startswith(tuple(UNATTENDED)):
            continue
        words = [word for word in command.words[1:] if word != "--live"]
        status = call(monkeypatch, tmp_path, [*words, *shlex.split(SHORT.get(command.verb, ""))])
        assert status == 0, f"{command}: {capsys.readouterr().err}"
