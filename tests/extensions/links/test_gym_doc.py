"""docs/extensions/links/gym.md: its programs run, and its table agrees with the code."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from processes import program

pytest.importorskip("gymnasium", reason="needs gymnasium; pip install agrobot-mj[gym]")

from agrobot_mj.extensions.links.gym.env import PREVIEW_M
from agrobot_mj.extensions.links.gym.observation import table

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs" / "extensions" / "links" / "gym.md").read_text(encoding="utf-8")
*PROGRAMS, PICTURE = re.findall(r"```python\n(.*?)```", TEXT, re.S)


def python(code):
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path, "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
    command = [sys.executable, "-W", "error::UserWarning", "-c", code]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_programs_on_the_page_run_in_order(tmp_path):
    done = program(tmp_path, "\n".join(PROGRAMS))
    assert (done.returncode, done.stderr) == (0, "")
    driven, drawn, shape = done.stdout.splitlines()
    assert re.fullmatch(r"completed 0\.\d+", driven)
    assert drawn.startswith("{'seed': ")
    assert "'plant.tyre.kind': " in drawn
    assert shape == "(4, 14)"


def test_program_shown_on_the_page_draws_its_figure():
    imports = PROGRAMS[0].split("\n\n")[0]
    done = python(f"{imports}\n{PICTURE}\nprint(picture.shape)")
    if "MuJoCo cannot find an OpenGL library" in done.stderr:
        pytest.skip("MuJoCo cannot find an OpenGL library for rendering")
    assert done.stdout == "(480, 640, 3)\n", done.stderr


def test_observation_table_matches_the_code():
    rows = [f"| `{o.name}` | {o.unit} | {o.bound:.3g} | {o.description} |" for o in table(PREVIEW_M, True, True)]
    assert "\n".join(rows) in TEXT
