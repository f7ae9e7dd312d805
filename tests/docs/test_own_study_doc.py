"""docs/own_study.md: its package adds a command, whose study can be resumed and extended."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

from processes import bare

import agrobot_mj

TEXT = (Path(__file__).parents[2] / "docs" / "own_study.md").read_text(encoding="utf-8")


def block(language):
    (found,) = re.findall(rf"```{language}\n(.*?)```", TEXT, re.S)
    return found


def test_example_study_runs_as_a_command_and_resumes(tmp_path):
    (tmp_path / "speeds.py").write_text(block("python"))
    group, line = block("toml").strip().splitlines()
    info = tmp_path / "speeds-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: speeds\nVersion: 1\n")
    group = group.removeprefix("[project.entry-points.").strip('"]')
    (info / "entry_points.txt").write_text(f"[{group}]\n{line.replace(chr(34), '')}\n")
    keys = ("--set", "plant.kind=bicycle", "--set", "duration_s=1", "--jobs", "1", "--json", "--out", "out")
    path = {"PYTHONPATH": f"{tmp_path}:{Path(agrobot_mj.__file__).parents[1]}"}

    def answer():
        done = bare(tmp_path, "-m", "agrobot_mj", "speeds", "circle", *keys, **path)
        assert done.returncode == 0, done.stderr
        rows = {file: file.stat().st_mtime_ns for file in tmp_path.glob("out/rows/*/*.json")}
        return json.loads(done.stdout), rows

    code = "import sys; from agrobot_mj.cli import app; app(['list'], standalone_mode=False); print(*sys.modules)"
    listed = [sys.executable, "-c", code]
    done = subprocess.run(listed, cwd=tmp_path, env=os.environ | path, capture_output=True, text=True, check=True)
    modules = set(done.stdout.splitlines()[-1].split())
    assert "speeds" in modules
    assert not modules & {"numpy", "agrobot_mj.scenario.schema"}
    found, rows = answer()
    assert [tried["of"] for tried in found["tried"]] == [3, 3, 3, 3]
    assert found["fastest_m_s"] == max(tried["speed_m_s"] for tried in found["tried"] if tried["kept"] == 3)
    assert json.loads((tmp_path / "out" / "speeds.json").read_text())["tried"] == found["tried"]
    assert (len(rows), answer()) == (12, (found, rows))
    (tmp_path / "speeds.py").write_text(block("python").replace("1.5, 2.0)", "1.5, 2.0, 2.5)"))
    more, extended = answer()
    assert more["tried"][:4] == found["tried"]
    assert rows.items() <= extended.items()
    assert len(extended) == 15


def test_example_study_needs_thirteen_names_of_the_package():
    names = [
        name
        for line in re.findall(r"^ *from (?:agrobot_mj.*) import (.*)$", TEXT, re.M)
        for name in line.split("#")[0].split(",")
    ]
    assert len(names) == 13
