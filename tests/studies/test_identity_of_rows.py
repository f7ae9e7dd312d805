"""Rows are reused only if none of their inputs has changed; one line states the changed inputs."""

import json
import os
import shutil
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pyarrow.parquet as pq
import pytest
from processes import bare, command

from agrobot_mj.core import identity as identities
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.identity import code_text, read_identity
from agrobot_mj.studies.engine import resume, tasks, workers
from agrobot_mj.studies.engine.tasks import Task, perform

pytestmark = pytest.mark.usefixtures("undrawn")
EXAMPLES = Path(__file__).parents[2] / "examples"
BICYCLE = ("--no-rrd", "--jobs", 1, "--plants", "bicycle", "--set", "duration_s=1.5")
COMPARE = ("compare", "mine.toml", "--guidance", "stanley", *BICYCLE, "--out", "out")
SWEEP = ("sweep", "s.toml", "--jobs", 1, "--out", "out")
AGAIN = "out: rows with another identity are run again: "
WAY = "x_m,y_m\n0,0\n7,0\n15,{end}\n"
LAW = """
from typing import Literal
from agrobot_mj.control import GuidanceLaw
from agrobot_mj.core.signals import Command
class Bent(GuidanceLaw):
    kind: Literal["bent"] = "bent"
    def update(self, state, situation, dt):
        return None, Command({angle}, 1.0)
"""


@pytest.fixture
def driven(monkeypatch):
    """Return a list of the seeds of all runs simulated so far."""
    real, seen = tasks.run, []

    def run(scenario, *watchers, branches=None):
        seen.append(scenario.seed)
        return real(scenario, *watchers)

    monkeypatch.setattr(tasks, "run", run)
    return seen


def written(folder, **files):
    """Write text files to a folder; `_` stands for the dot in their names."""
    for name, text in files.items():
        (folder / name.replace("_", ".")).write_text(text)


def errors(folder, name="comparison.json"):
    """Return the cross-track errors in the rows of a comparison."""
    return [row["xte_rms"] for row in json.loads((folder / name).read_text())]


def body(mass):
    """Return the example body with a given mass of the chassis [kg]."""
    return (EXAMPLES / "own_body.xml").read_text().replace('mass="590.5"', f'mass="{mass}"')


MACHINE = {"m_toml": '[tractor]\nmjcf = "parts/b.xml"\n', "mine_toml": 'machine = "m.toml"\n[path]\nkind = "line"\n'}


def test_sweep_run_is_repeated_after_editing_the_body_of_a_machine(call, driven, tmp_path):
    written(tmp_path, **MACHINE)
    (tmp_path / "parts").mkdir()
    masses = []
    for mass, runs, said in ((640.25, 1, ""), (640.25, 1, ""), (1180.75, 2, f"{AGAIN}1 with other files\n")):
        (tmp_path / "parts" / "b.xml").write_text(body(mass))
        assert call(*COMPARE)[0::2] == (0, said)
        assert len(driven) == runs
        (scenario,) = tmp_path.glob("out/*/scenario.toml")
        masses.append(tomllib.loads(scenario.read_text())["tractor"]["mass_kg"])
    assert masses[2] - masses[0] == pytest.approx(1180.75 - 640.25)


def test_sweep_run_is_repeated_after_editing_the_machine_file(call, driven, tmp_path):
    written(tmp_path, m_toml="[tractor]\nmass_kg = 790.0\n", mine_toml='machine = "m.toml"\n[path]\nkind = "line"\n')
    assert call(*COMPARE)[0] == call(*COMPARE)[0] == 0
    assert len(driven) == 1
    written(tmp_path, m_toml="[tractor]\nmass_kg = 791.0\n")
    assert call(*COMPARE)[2] == f"{AGAIN}1 with other files\n"
    assert len(driven) == 2


@pytest.mark.parametrize("study", [COMPARE, SWEEP], ids=["compare", "sweep"])
def test_results_are_still_valid_after_moving_the_folder(call, driven, monkeypatch, tmp_path, study):
    place = tmp_path / "one"
    place.mkdir()
    written(place, way_csv=WAY.format(end=2), mine_toml='[path]\nkind = "waypoints"\nfile = "way.csv"\n')
    written(place, s_toml='base = "mine.toml"\nseeds = 2\n[set]\nduration_s = 1.5\n"plant.kind" = "bicycle"\n')
    monkeypatch.chdir(place)
    call(*study)
    shutil.copytree(place, tmp_path / "copied")  # all files anew
    place.rename(tmp_path / "two")
    runs = len(driven)
    for moved in ("two", "copied"):
        monkeypatch.chdir(tmp_path / moved)
        assert call(*study)[0::2] == (0, "")
    assert len(driven) == runs > 0


def test_sweep_runs_from_the_copies_of_its_data_files(call, monkeypatch, tmp_path):
    written(tmp_path, way_csv=WAY.format(end=0), mine_toml='[path]\nkind = "waypoints"\nfile = "way.csv"\n')
    written(tmp_path, s_toml='base = "mine.toml"\nseeds = 4\n[set]\nduration_s = 9\n"plant.kind" = "bicycle"\n')
    call("sweep", "s.toml", "--jobs", 1, "--out", "undisturbed")
    real, count = tasks.run, []

    def run(scenario, *watchers, branches=None):
        count.append(scenario.seed)
        if len(count) == 2:
            written(tmp_path, way_csv=WAY.format(end=6))
            tasks._base.cache_clear()  # as in a worker that starts late
        return real(scenario, *watchers)

    monkeypatch.setattr(tasks, "run", run)
    call(*SWEEP)
    quiet, disturbed = (pq.read_table(tmp_path / name / "sweep.parquet") for name in ("undisturbed", "out"))
    assert quiet.drop_columns("wall_s").equals(disturbed.drop_columns("wall_s"))
    (copy,) = tmp_path.glob("out/inputs/*/way.csv")
    copy.write_text(WAY.format(end=3))
    (copy.parent / ".way.csv.0123abcd.part").write_text("x_m")  # of a killed command
    assert call(*SWEEP)[2].startswith(f"{AGAIN}4 with other files\n")  # the file that is there now
    assert sorted(file.name for file in tmp_path.glob("out/inputs/*/*")) == ["way.csv", "way.csv"]
    changed = pq.read_table(tmp_path / "out" / "sweep.parquet")
    assert not set(changed["xte_rms"].to_pylist()) & set(quiet["xte_rms"].to_pylist())
    written(tmp_path, way_csv=WAY.format(end=0))
    call(*SWEEP)  # not from the copy, which is damaged
    again = pq.read_table(tmp_path / "out" / "sweep.parquet")
    assert quiet.drop_columns("wall_s").equals(again.drop_columns("wall_s"))


def test_run_is_repeated_if_more_output_is_requested(call, driven, tmp_path):
    text = 'base = "circle"\nseeds = 2\nkeep = "{}"\n[set]\nduration_s = 1\n"plant.kind" = "bicycle"\n'
    for keep, total in (("table", 2), ("signals", 4), ("table", 4), ("signals", 4), ("failures", 4)):
        written(tmp_path, s_toml=text.format(keep))
        assert call(*SWEEP)[0::2] == (0, "")
        assert len(driven) == total
        assert f'keep = "{keep}"' in (tmp_path / "out" / "sweep.toml").read_text()
    assert (tmp_path / "out" / "runs" / "00000001" / "signals.parquet").is_file()


def test_sweep_runs_that_ended_with_an_error_are_repeated(call, monkeypatch, tmp_path):
    written(tmp_path, s_toml='base = "circle"\nseeds = 3\n[set]\nduration_s = 1\n"plant.kind" = "bicycle"\n')
    real = tasks.run

    def fragile(scenario, *watchers, branches=None):
        if scenario.seed == 2:
            raise RuntimeError("out of luck")
        return real(scenario, *watchers)

    monkeypatch.setattr(tasks, "run", fragile)
    assert call(*SWEEP)[1].startswith("3 runs done, of which 1 did not")
    monkeypatch.setattr(tasks, "run", real)
    assert call(*SWEEP)[1].startswith("1 runs done, 2 already present")
    assert pq.read_table(tmp_path / "out" / "sweep.parquet")["error"].to_pylist() == [None] * 3


@pytest.fixture
def other_numba(monkeypatch):
    """Return a function that changes the reported version of Numba."""
    real = identities._version

    def change():
        monkeypatch.setattr(identities, "_version", lambda name: "0.99" if name == "numba" else real(name))
        identities.libraries.cache_clear()

    yield change
    monkeypatch.undo()
    identities.libraries.cache_clear()


def test_results_of_other_library_versions_are_repeated_not_merged(call, driven, other_numba, tmp_path):
    written(tmp_path, s_toml='base = "circle"\nseeds = 4\n[set]\nduration_s = 1\n"plant.kind" = "bicycle"\n')
    for shard, folder in ((1, "a"), (2, "b")):
        call("sweep", "s.toml", "--jobs", 1, "--shard", f"{shard}/2", "--out", folder)
    other_numba()
    status, _, err = call("sweep", "s.toml", "--jobs", 1, "--shard", "2/2", "--out", "b")
    assert (status, err) == (0, "b: rows with another identity are run again: 2 with other libraries\n")
    assert len(driven) == 6
    status, _, err = call("sweep", "--merge", "a", "b", "--out", "whole")
    assert (status, err.splitlines()[0]) == (
        2,
        "b: the folder belongs to another sweep: different libraries; "
        "run the same sweep in all folders, or omit this folder",
    )
    assert not (tmp_path / "whole" / "sweep.parquet").exists()
    rows = pq.read_table(tmp_path / "b" / "sweep.parquet").to_pylist()
    assert {row["identity"].partition("-00000000-")[2] for row in rows} == {f"00000000-{code_text()[9:]}"}


def test_report_rejects_result_rows_from_different_code_versions(call, tmp_path):
    written(tmp_path, mine_toml='[path]\nkind = "line"\n')
    call(*COMPARE, "--seeds", 2)
    assert call("report", "out")[0] == 0
    file = tmp_path / "out" / "comparison.json"
    rows = json.loads(file.read_text())
    rows[1]["identity"] = rows[1]["identity"][:-8] + "12345678"
    file.write_text(json.dumps(rows))
    status, _, err = call("report", "out")
    assert status == 2
    assert "out: the rows come from different code versions (" in err


def test_runs_whose_table_rows_have_no_identity_are_repeated(call, driven, tmp_path):
    written(tmp_path, mine_toml='[path]\nkind = "line"\n')
    call(*COMPARE)
    (row,) = tmp_path.glob("out/rows/*/*.json")
    row.write_text(json.dumps({**json.loads(row.read_text()), "task": "0123456789abcdef"}))
    assert call(*COMPARE)[2] == f"{AGAIN}1 without identity\n"
    assert len(driven) == 2


@pytest.mark.parametrize("edited", ["plug.py", "helping.py", "parts/law.py"])
def test_sweep_run_is_repeated_after_editing_a_plugin(tmp_path, edited):
    """Edited are a plugin file, a module that it imports, and an installed package, in separate processes."""
    package = tmp_path / "site" / "parts"
    package.mkdir(parents=True)
    dist = tmp_path / "site" / "parts-1.dist-info"
    dist.mkdir()
    written(dist, METADATA="Metadata-Version: 2.1\nName: parts\nVersion: 1\n")
    (dist / "entry_points.txt").write_text("[agrobot_mj.plugins]\nparts = parts\n")
    written(package, law_py=LAW.format(angle="0.02").replace("bent", "installed"))
    (package / "__init__.py").write_text("from parts.law import Bent\n")
    written(tmp_path, helping_py="ANGLE = 0.03\n")
    written(tmp_path, plug_py="from helping import ANGLE\n" + LAW.format(angle="ANGLE"))
    kind = "installed" if edited.startswith("parts") else "bent"
    text = 'base = "straight_line"\n[set]\nduration_s = 1\n"plant.kind" = "bicycle"\n'
    written(tmp_path, s_toml=f'{text}"guidance.kind" = "{kind}"\n')

    def swept():
        more = ["--plugin", "plug.py"] if kind == "bent" else []
        words = ("sweep", "s.toml", "--jobs", "1", "-q", "--out", "out", *more)
        if kind == "bent":
            keeping = "import sys\nsys.dont_write_bytecode = False"
            done = command(tmp_path, *words, before=keeping)
        else:  # the server has looked for installed plugins already
            path = f"{tmp_path / 'site'}:{EXAMPLES.parent}"
            done = bare(tmp_path, "-m", "agrobot_mj", *words, PYTHONPATH=path)
        assert done.returncode == 0, done.stderr
        return done.stderr, pq.read_table(tmp_path / "out" / "sweep.parquet")["lateral_abs_p95"].to_pylist()

    said, before = swept()
    assert said == ""
    file = tmp_path / ("site/parts/law.py" if edited.startswith("parts") else edited)
    times = file.stat()
    file.write_text(file.read_text().replace("0.0", "0.1").replace("Command(ANGLE", "Command(0.2 + ANGLE"))
    # Plugin files are edited within the same second, with the same length. An installed package is edited later,
    # because Python would import its bytecode after such an edit.
    later = 2 * 10**9 if edited.startswith("parts") else 0
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns + later))
    said, after = swept()
    assert said == f"{AGAIN}1 with other plugins\n"
    assert before != after


def test_run_identity_depends_on_the_order_of_overrides(tmp_path):
    table, key = ("path", {"kind": "circle", "radius_m": 5.0}), ("path.radius_m", 7.0)
    tasks = [Task("{}", "circle", dict(each)) for each in ((table, key), (key, table))]
    assert len({resume.RowFiles(tmp_path).with_identity(task).identity for task in tasks}) == 2


def test_worker_with_a_different_code_version_rejects_the_task(monkeypatch, tmp_path):
    other = code_text()[:-8] + "fedcba98"
    with pytest.raises(ScenarioError, match="circle: a worker uses different libraries"):
        perform(Task("{}", "circle", {}, identity=read_identity(f"0-0-{other}")))
    client = SimpleNamespace(run=lambda function, plugins: {"tcp://w:1": other}, nthreads=lambda: {"w": 1})
    with pytest.raises(ScenarioError, match="--scheduler tcp://s:1: worker tcp://w:1 uses different libraries"):
        workers._workers(client, "tcp://s:1")
    client.run = lambda function, plugins: {"w": function(plugins)}
    assert workers._workers(client, "tcp://s:1") == 1
