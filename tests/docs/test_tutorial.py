"""docs/tutorial.md: all commands run in order, in shorter simulations or, with `-m slow`, in full length."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from processes import command, free_ports, in_process, omit_figures
from removed import needs_all
from told import without_progress

pytestmark = needs_all
ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"(?:as|it\nas) `(\w+\.(?:toml|py))`:\n\n```\w+\n(.*?)```", TEXT, re.S))
LINES = [line for block in re.findall(r"^```sh\n(.*?)```", TEXT, re.S | re.M) for line in block.splitlines()]
COMMANDS = [shlex.split(line)[1:] for line in LINES if line.startswith("agrobot-mj ")]
(SCRIPT,) = (code for code in re.findall(r"^```python\n(.*?)```", TEXT, re.S | re.M) if "read_table" in code)
FULL_S, SHORT_S = {"meadow.toml": 40, "circle": 105}, {"meadow.toml": 2, "circle": 20}
"""Durations of the page's scenarios [s]."""


ON_ONE_CORE = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})"


def in_a_process_of_its_own(arguments):
    """Run a command as `in_process` does, in a separate process on one core, so that comparisons start no workers."""
    done = command(Path.cwd(), *arguments, before=ON_ONE_CORE)
    assert (done.returncode, without_progress(done.stderr)) == (0, ""), arguments
    return done.stdout


def linked(arguments):
    """Return the output of the link with the page's host, on free ports and as fast as the host replies."""
    own, other = free_ports()
    (host,) = (shlex.split(line) for line in LINES if line.startswith("python examples"))
    words = [sys.executable, str(ROOT / host[1]), *host[2:], f"--port={other}", f"--board-port={own}", "--duration=120"]
    process = subprocess.Popen(words, env={**os.environ, "PYTHONPATH": str(ROOT)}, stderr=subprocess.DEVNULL)
    try:
        shorter = ["--port", str(own), "--host-port", str(other), "--pace", "answered", "--duration", "10"]
        return in_process([*arguments, *shorter])
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module", params=["short", pytest.param("full", marks=pytest.mark.slow)])
def walk(request, tmp_path_factory):
    """Return the folder in which all commands were executed in order, their outputs, and whether in full length."""
    pytest.importorskip("plotly", reason="needs the extra report")
    folder, full = tmp_path_factory.mktemp("walk"), request.param == "full"
    durations = FULL_S if full else SHORT_S
    for name, content in FILES.items():
        short = content.replace("duration_s = 40", f"duration_s = {durations['meadow.toml']}")
        (folder / name).write_text(short, encoding="utf-8")
    said, before = [], Path.cwd()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("agrobot_mj.studies.engine.workers.cores", lambda: 1)
        if not full:
            omit_figures(patch)
        try:
            os.chdir(folder)
            said = [executed(arguments, durations) for arguments in COMMANDS]
        finally:
            os.chdir(before)
    return folder, "\n".join(said), full


def executed(arguments, durations):
    """Return the output of a command of the page. For `view`, which needs a display, return the size of the file."""
    match arguments[0]:
        case "view":
            return f"{Path(arguments[1]).stat().st_size} bytes"
        case "link":
            return linked(arguments)
        case "sweep":
            return in_process([*arguments, "--jobs", "1"])
        case "run" if arguments[1] == "circle":
            return in_process([*arguments, "--no-rrd", "--set", f"duration_s={durations['circle']}"])
    return (in_a_process_of_its_own if "--plugin" in arguments else in_process)(arguments)


def rows(folder):
    return json.loads((folder / "comparison.json").read_text(encoding="utf-8"))


def test_first_tutorial_commands_work_in_a_fresh_clone(tmp_path):
    if not (ROOT / ".git").exists():
        pytest.skip("this is no checkout")
    clone, *_, make, activate = LINES[:4]
    assert clone.startswith("git clone ")
    subprocess.run(["git", "clone", "-q", str(ROOT), str(tmp_path / "clone")], check=True)
    would = subprocess.run([*make.split(), "-n"], cwd=tmp_path / "clone", capture_output=True, text=True, check=True)
    assert "-r requirements.lock" in would.stdout
    assert "agrobot_mj compare figure_eight --controllers pd,pd_t2fnn --plants bicycle,mujoco" in would.stdout
    assert activate == ". .venv/bin/activate"


def test_demo_command_compares_four_runs(tmp_path, monkeypatch):
    (line,) = re.findall(r"-m agrobot_mj (compare .*) --out", (ROOT / "Makefile").read_text(encoding="utf-8"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("agrobot_mj.studies.engine.workers.cores", lambda: 1)
    omit_figures(monkeypatch)
    said = in_process([*line.split(), "--set", "duration_s=1", "--out", "demo"])
    assert said.count("completed") == 4
    assert (tmp_path / "demo" / "mujoco-pd_t2fnn-s1" / "run.rrd").stat().st_size > 10_000


def test_explain_command_prints_unit_and_source(walk):
    _, said, _ = walk
    assert "stiffness_per_load  5.3" in said
    assert re.search(r"source +Assumed", said)


def test_tractor_with_softer_front_axle_understeers(walk, monkeypatch, capsys):
    folder, _, _ = walk
    monkeypatch.chdir(folder)
    exec(SCRIPT, {})
    before, after = (float(value) for value in re.findall(r"([\d.]+) rad", capsys.readouterr().out))
    assert 0.10 < before < after < 0.25


def test_slope_example_of_the_tutorial_writes_a_recording(walk):
    folder, said, _ = walk
    signals = pq.read_table(folder / "runs" / "meadow" / "signals.parquet").to_pydict()
    assert min(signals["roll"]) < -0.1 or max(signals["roll"]) > 0.1, "an 8 degree slope rolls the tractor"
    assert "meadow: completed" in said
    assert "agrobot-mj view runs/meadow/run.rrd" in TEXT
    assert int(re.findall(r"(\d+) bytes", said)[0]) > 10_000


def test_law_comparison_with_full_estimator_has_no_slope_error(walk):
    folder, _, full = walk
    laws, levelled = rows(folder / "runs" / "laws"), rows(folder / "runs" / "levelled")
    assert [(row["guidance"], row["seed"]) for row in laws] == [(g, s) for g in ("stanley", "lqr") for s in (1, 2)]
    assert {row["variant"] for row in levelled} == {"as it is", "levelled"}
    if full:
        errors = {(row["variant"], row["guidance"]): row["xte_rms"] for row in levelled}
        for law in ("stanley", "lqr"):
            assert 0.08 < errors["as it is", law] < 0.25
            assert errors["levelled", law] < 0.05


def test_tutorial_sweep_has_a_row_per_run_and_a_report(walk):
    folder, said, _ = walk
    table = pq.read_table(folder / "runs" / "slopes" / "sweep.parquet")
    assert table.num_rows == 16
    assert set(table["outcome"].to_pylist()) == {"completed"}
    assert "16 runs done" in said
    assert "lqr" in (folder / "runs" / "slopes" / "report.html").read_text(encoding="utf-8")


def test_user_defined_law_runs_and_is_compared(walk):
    folder, _, full = walk
    assert 'kind = "two_gains"' in (folder / "runs" / "mine" / "scenario.toml").read_text(encoding="utf-8")
    found = {row["guidance"]: row["xte_rms"] for row in rows(folder / "runs" / "against")}
    assert set(found) == {"two_gains", "lqr"}
    assert all(error < (0.25 if full else 0.1) for error in found.values())


def test_user_defined_law_can_be_swept(walk, monkeypatch):
    folder, _, _ = walk
    (line,) = re.findall(r"`agrobot-mj (sweep [^`]*)`", TEXT)
    text = FILES["slopes.toml"].replace('["stanley", "lqr"]', '["two_gains"]').replace("seeds = 2", "seeds = 1")
    (folder / "slopes.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(folder)
    in_a_process_of_its_own([*line.split(), "--jobs", "1"])
    table = pq.read_table(folder / line.split()[-1] / "sweep.parquet")
    assert table["guidance.kind"].to_pylist() == ["two_gains"] * 4
    assert set(table["outcome"].to_pylist()) == {"completed"}


def test_host_program_of_the_tutorial_steers_the_tractor(walk):
    folder, _, _ = walk
    metrics = json.loads((folder / "runs" / "linked" / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["outcome"] == "completed"
    assert metrics["link"]["engagements"] == 1
    assert metrics["link"]["engaged_s"] > 4
    assert pq.read_table(folder / "runs" / "linked" / "link.parquet").num_rows > 100
