"""docs/cookbook.md: its files, commands and C++ program work in the given order, in shorter runs."""

import contextlib
import json
import re
import shlex
import shutil
import socket
import subprocess
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from processes import free_ports, in_process, omit_figures
from removed import needs_all
from test_commands import SHORT

from agrobot_mj import load_scenario

pytestmark = needs_all
ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "cookbook.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"as `(\w+\.toml)`:\n\n```toml\n(.*?)```", TEXT, re.S))
LINES = [line for block in re.findall(r"^```sh\n(.*?)```", TEXT, re.S | re.M) for line in block.splitlines()]
COMMANDS = [shlex.split(line)[1:] for line in LINES if line.startswith("agrobot-mj ")]
SURVEY = "latitude,longitude\n50.8770,4.6990\n50.8770,4.6996\n50.8772,4.7000\n"
"""Waypoints at distances of about 40 m, with a gentle bend."""
BOUNDARY = "latitude,longitude\n50.8770,4.6990\n50.8770,4.7000\n50.8776,4.7000\n50.8776,4.6990\n"
"""Corners of a field of 0.5 ha."""
LOG = "time_s,steer_angle_deg,speed_km_h,latitude,longitude,fix_quality\n" + "".join(
    f"{k / 10},2.0,5.4,{50.877 + k * 1e-6},4.699,4\n" for k in range(400)
)
"""Log whose columns have a built-in map."""
BRIEF = "--set duration_s=30 --set plant.kind=bicycle --no-rrd --quiet"
QUICKER = {
    **SHORT,
    "field": BRIEF.replace(" --quiet", ""),
    "run": "--set duration_s=2 --no-rrd --quiet",
    "compare": f"{SHORT['compare']} --seeds 1",
}


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Return the folder in which all commands except the C++ program were executed in order, and their output by
    verb."""
    folder, said = tmp_path_factory.mktemp("cookbook"), {}
    for name, content in {**FILES, "survey.csv": SURVEY, "boundary.csv": BOUNDARY, "field.csv": LOG}.items():
        (folder / name).write_text(content, encoding="utf-8")
    with contextlib.chdir(folder), pytest.MonkeyPatch.context() as patch:
        patch.setattr("agrobot_mj.studies.engine.workers.cores", lambda: 1)
        omit_figures(patch)
        for verb, *rest in COMMANDS:
            if verb != "link":
                said[verb] = in_process([verb, *rest, *shlex.split(QUICKER.get(verb, ""))])
    return folder, said


def metrics(folder):
    return json.loads((folder / "metrics.json").read_text(encoding="utf-8"))


def test_every_cookbook_question_is_answered_by_a_command():
    assert [words[0] for words in COMMANDS] == [
        *("run", "run", "field", "report", "link", "compare", "twin", "limit", "risk")
    ]


def test_tractor_defined_by_mass_and_wheelbase_drives_a_surveyed_field(walk):
    folder, _ = walk
    path = load_scenario(folder / "field.toml").path
    length = np.subtract(path.at(path.duration_s)[:2], path.at(0.0)[:2])
    assert length == pytest.approx([70.4, 22.2], abs=0.3), "0.001 deg east and 0.0002 deg north at 51 degrees"
    assert 'machine = "mine.toml"' in (folder / "runs" / "mine" / "scenario.toml").read_text(encoding="utf-8")
    signals = pq.read_table(folder / "runs" / "field" / "signals.parquet")
    loads = sum(signals[f"load_{wheel}"].to_numpy() for wheel in ("fl", "fr", "rl", "rr"))
    assert np.median(loads) == pytest.approx(4200 * 9.81, rel=0.05)


def test_field_command_writes_coverage_and_a_report(walk):
    folder, said = walk
    found = json.loads((folder / "runs" / "work" / "coverage.json").read_text(encoding="utf-8"))
    assert found["areas"]["field"]["area_m2"] == pytest.approx(4700, rel=0.02)
    assert "ha worked at least once" in said["field"]
    assert (folder / "runs" / "work" / "report.html").is_file()


def test_compare_limit_and_risk_commands_write_their_results(walk):
    folder, said = walk
    rows = json.loads((folder / "runs" / "which" / "comparison.json").read_text(encoding="utf-8"))
    assert [(row["guidance"], row["outcome"]) for row in rows] == [
        (law, "completed") for law in ("stanley", "lqr", "pure_pursuit")
    ]
    assert "read as columns, 39.9 s" in said["twin"]
    assert "The log has the columns for replay" in said["twin"]
    assert (folder / "runs" / "steep" / "limit.json").is_file()
    assert (folder / "runs" / "rare" / "risk.json").is_file()


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """Return the C++ law, compiled as described on the page."""
    build, _ = [line.split() for line in LINES if "udp_law" in line]
    if shutil.which(build[0]) is None:
        pytest.skip(f"needs a C++ compiler, {build[0]}")
    folder = tmp_path_factory.mktemp("law")
    source = ROOT / build.pop()
    done = subprocess.run(
        [*build, "-Wall", "-Wextra", "-Werror", str(source)], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder / "udp_law"


def test_cpp_law_steers_the_tractor_over_udp(program, tmp_path):
    """The tractor starts 1 m from the line and approaches it to within decimetres, as fast as the law replies."""
    (link,) = (words for words in COMMANDS if words[0] == "link")
    own, boards = free_ports()
    law = subprocess.Popen([str(program), str(own), str(boards)], stdout=subprocess.PIPE, text=True)
    try:
        ports = ["--port", str(boards), "--host-port", str(own), "--pace", "answered", "--no-rrd"]
        with contextlib.chdir(tmp_path):
            in_process([*link, *ports, "--duration", "14"])
    finally:
        law.terminate()
        law.wait()
    found = metrics(tmp_path / "runs" / "udp")
    assert found["outcome"] == "completed"
    assert found["link"]["engagements"] == 1
    assert found["link"]["engaged_s"] > 10
    left = pq.read_table(tmp_path / "runs" / "udp" / "signals.parquet")["rear_y"].to_numpy()
    assert left[0] == pytest.approx(1.0, abs=0.05)
    assert np.abs(left[-20:]).max() < 0.15


def test_cpp_law_reports_that_its_port_is_in_use(program):
    own, boards = free_ports()
    with socket.socket(type=socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", own))
        done = subprocess.run([str(program), str(own), str(boards)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 1
    assert done.stderr.startswith("bind: ")
