"""Files of other programs in an output folder are never changed by a command."""

import json
import os
import shutil
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest
from linked import farm, linked_run, strip_rows
from removed import is_there
from row_files import row_file
from typer.main import get_command

from agrobot_mj import cli, load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.recording import Recording
from agrobot_mj.recording.transport import snapshot
from agrobot_mj.simulation.results import HEAD, MARK, atomic, claim, is_bare, results, write_json
from agrobot_mj.simulation.storage import RECORDING, SET, write_log

BICYCLE = ("--set", "plant.kind=bicycle", "--set", "duration_s=0.5")
SWEEP = 'base = "circle"\n[set]\n"plant.kind" = "bicycle"\nduration_s = 0.2\n[axes]\n"path.radius_m" = [8, 9, 10, 11]\n'
LIMIT = ("--key", "path.speed_m_s", "--range", "1:3", "--until", "xte_rms > 1", "--max-seeds", 1, "--jobs", 1)
VARIED = ("--vary", "path.speed_m_s=1:3", "--vary", "path.radius_m=8:11")
HERE, MINE = "HERE", "MINE"  # Stand for the stranger's folder, and for the folder with sources of one's own
WRITERS = {
    "run": [("circle", *BICYCLE, "--out", HERE), (f"{MINE}/way.toml", *BICYCLE, "--no-rrd", "--out", HERE)],
    "compare": [("circle", "--controllers", "pd", "--plants", "bicycle", *BICYCLE, "--out", HERE)],
    "sweep": [
        (f"{MINE}/small.toml", "--jobs", 1, "--out", HERE),
        (f"{MINE}/small.toml", "--jobs", 1, "--fresh", "--out", HERE),
        (f"{MINE}/small.toml", "--jobs", 1, "--shard", "1/2", "--out", HERE),
        (f"{MINE}/small.toml", "--jobs", 1, "--shard", "1/2", "--fresh", "--out", HERE),
        ("--merge", f"{MINE}/swept", "--out", HERE),
        ("--merge", HERE),
    ],
    "limit": [("circle", *LIMIT, *BICYCLE, "--out", HERE)],
    "risk": [("circle", "--until", "xte_abs_max > 5", "--particles", 2, "--repeats", 2, *BICYCLE, "--out", HERE)],
    "falsify": [("circle", *VARIED, "--until", "xte_abs_max > 5", "--budget", 20, *BICYCLE, "--out", HERE)],
    "link": [("straight_line", "--pace", "answered", "--wait", 0, *BICYCLE, "--out", HERE)],
    "ros2": [("circle", "--wait", 0, *BICYCLE, "--out", HERE)],
    "export": [(f"{MINE}/driven", "--mcap", "--out", HERE), (HERE, "--mcap")],
    "snapshot": [(f"{MINE}/run.rrd", "--at", 1, "--out", HERE)],
    "rig": [("linear", "--out", HERE)],
    "twin": [
        (f"{MINE}/driven", "--out", HERE),
        *((f"{MINE}/driven", "--only", part, "--out", HERE) for part in ("calibrate", "identify", "replay", "valve")),
        *((HERE, "--only", part) for part in ("identify", "valve")),
    ],
    "validate": [("--quick", "--out", HERE)],
    "tune": [("circle", "--guidance", "stanley", "--budget", 8, *BICYCLE, "--out", HERE)],
    "report": [(HERE,)],
    "field show": [(f"{MINE}/home.geojson", "--out", HERE)],
    "field plan": [(f"{MINE}/home.geojson", "--width", 4, "--headlands", 1, "--out", HERE)],
    "field run": [(f"{MINE}/home.geojson", "--width", 4, "--headlands", 1, "--no-rrd", "--out", HERE)],
    "field compare": [(f"{MINE}/linked/run", f"{MINE}/farm", "--out", HERE)],
    "play": [("circle", "--no-browser", "--seconds", 0.2, *BICYCLE, "--out", HERE)],
}
"""Ways in which each command writes into a folder."""
READERS = {"list", "explain", "init", "schema", "machine", "view"}
"""Commands that write no result files. `init` writes only a new file."""
BUILT_BY = {"field compare": "link"}  # Commands whose input another command writes
CASES = [
    (name, arguments)
    for name, ways in WRITERS.items()
    if is_there(name) and is_there(BUILT_BY.get(name, name))
    for arguments in ways
]
NAMES = (*SET, RECORDING, "comparison.json", "comparison.rrd", "bicycle-pd", "limit.json", "limit.png", "tuning.json")
NAMES = (*NAMES, "base.toml", "sweep.toml", "plan.json", "sweep.parquet", "way.csv", "run.mcap", "drive_1.png")
NAMES = (*NAMES, *(f"replay.{end}" for end in ("json", "parquet", "png", "toml")), "report.html", "ranking.png")
NAMES = (*NAMES, "map.toml", "calibration.json", "machine.toml", "twin.json")
NAMES = (*NAMES, "curves.parquet", "validation.json", "validation.md", "importance.json", "lateral.png")
NAMES = (*NAMES, "map.png", "plan.geojson", "plan.png", "coverage.json", "coverage.geojson", "inputs.csv")
NAMES = (*NAMES, "recorded.json", "recorded.png")
FOLDERS = ("rows/00000/00000001.json", "rows/mine.csv", "runs/00000001/metrics.json", "images/step_steer.png")


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """Return a folder with inputs of the commands: a run, a sweep, a recording, and a scenario with a data file."""
    mine = tmp_path_factory.mktemp("mine")
    (mine / "small.toml").write_text(SWEEP)
    ring = [[5.0, 52.0], [5.0004, 52.0], [5.0004, 52.0002], [5.0, 52.0002], [5.0, 52.0]]
    (mine / "home.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    (mine / "way.csv").write_text("x_m,y_m\n0,0\n10,0\n20,1\n")
    (mine / "way.toml").write_text('[path]\nkind = "waypoints"\nfile = "way.csv"\n')
    (mine / "run.rrd").write_bytes(b"RRF2" + b"RRF2FOOT" + bytes(8))
    write_log(run(load_scenario("circle", {"duration_s": 1.0, "plant.kind": "bicycle"})), mine / "driven")
    if is_there("link"):
        linked_run(mine / "linked", 3, lambda t: 1)
    farm(mine / "farm", strip_rows([(40, 26), (40, 24), (44, 26), (44, 24)]))
    from agrobot_mj.studies.sweep.runner import SweepOptions, sweep

    sweep(mine / "small.toml", mine / "swept", SweepOptions(jobs=1, quiet=True))
    return mine


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Return an empty working directory. A test double replaces the viewer of snapshots."""
    monkeypatch.chdir(tmp_path)
    layout = {0: {"ContainerBlueprint": {}}}
    viewer = SimpleNamespace(set_blueprint=lambda *_: None)
    monkeypatch.setattr(snapshot, "_viewer", lambda *_: nullcontext(viewer))
    monkeypatch.setattr(snapshot, "_open_recording", lambda *_: layout)
    monkeypatch.setattr(snapshot, "_tabs", lambda *_: (0, {"Drive": 0}))
    monkeypatch.setattr(snapshot, "_end", lambda *_: 60.0)
    monkeypatch.setattr(snapshot, "_picture", lambda *_: b"png")
    return tmp_path


def full(folder, content=b"mine"):
    """Fill a folder with files of other programs that have the names of result files."""
    for name in (*NAMES, *FOLDERS, "notes.txt", ".notes.txt.1a2b3c4d.part"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def contents(*folders):
    """Return all links and file contents below some folders, except the mark file of this program."""
    found = {}
    for folder in folders:
        for top, inner, files in os.walk(folder):
            for path in (Path(top, name) for name in (*inner, *files) if name != MARK):
                found[path] = path.readlink() if path.is_symlink() else path.is_dir() or path.read_bytes()
    return found


def asked(call, sources, name, arguments, here):
    """Return exit status and stderr of a command in the folder `here`."""
    words = [str(word).replace(HERE, str(here)).replace(MINE, str(sources)) for word in arguments]
    return call(*name.split(), *words)[::2]


def refused(status, err):
    """Return whether a command was rejected with a message of one line."""
    return status == 2 and len(err.strip().splitlines()) == 1


def test_every_command_that_writes_files_is_tested():
    commands = get_command(cli.app).commands
    assert set(commands) == {name for name in {*WRITERS, *READERS} if is_there(name)}
    for name, command in commands.items():
        options = {option for parameter in command.params for option in parameter.opts}
        for option in options & {"--out", "--fresh", "--merge"}:
            assert any(option in arguments for arguments in WRITERS[name]), f"{name} {option}"


@pytest.mark.parametrize(("name", "arguments"), CASES, ids=lambda part: part if isinstance(part, str) else "-")
@pytest.mark.parametrize("dot", [False, True])
def test_output_folder_with_foreign_files_is_rejected(call, sources, place, name, arguments, dot, monkeypatch):
    folder = place / "theirs"
    full(folder)
    before = contents(place)
    if dot:
        monkeypatch.chdir(folder)
    status, err = asked(call, sources, name, arguments, "." if dot else folder)
    assert contents(place) == before
    assert refused(status, err), (status, err)


@pytest.mark.parametrize(("name", "arguments"), CASES, ids=lambda part: part if isinstance(part, str) else "-")
def test_foreign_files_in_a_results_folder_are_kept(call, sources, place, name, arguments):
    folder = place / "ours"
    claim(folder, ())
    full(folder)
    before = contents(folder)
    status, err = asked(call, sources, name, arguments, folder)
    assert contents(folder) == before
    assert refused(status, err), (status, err)


LIGHT = [case for case in CASES if case[0] not in ("rig", "tune", "play")]
"""Commands that take a few seconds and do not start the viewer, which needs a separate process."""


ALL_NAMES = f"{HEAD}\n" + "\n".join((*NAMES, "rows", "runs", "images"))
OTHERS = [
    pytest.param(*case, marked, id=f"{case[0]}-{name}", marks=[] if k % 4 == turn else [pytest.mark.slow])
    for marked, name, turn in ((HEAD, "no names", 0), ("", "empty", 2))
    for k, case in enumerate(LIGHT)
]


@pytest.mark.parametrize(
    ("name", "arguments", "marked"),
    [*(pytest.param(*case, ALL_NAMES, id=f"{case[0]}-all names") for case in LIGHT), *OTHERS],
)
def test_links_in_a_results_folder_are_not_followed(call, sources, place, name, arguments, marked):
    """All names of result files are links to another folder, with and without the mark of this program."""
    folder, away = place / "shared", place / "away"
    full(away)
    folder.mkdir()
    (folder / MARK).write_text(marked)
    for path in away.iterdir():
        (folder / path.name).symlink_to(path)
    before = contents(away)
    status, err = asked(call, sources, name, arguments, folder)
    assert contents(away) == before
    assert "Traceback" not in err
    assert status in (0, 1, 2)


def test_marker_file_that_is_a_link_is_ignored(place):
    full(place / "theirs")
    (place / "list").write_text("notes.txt\n")
    (place / "theirs" / MARK).symlink_to(place / "list")
    with pytest.raises(ScenarioError, match="was not written by agrobot-mj"):
        claim(place / "theirs", ["notes.txt"])
    claim(place / "theirs", ["new.txt"])
    assert (place / "list").read_text() == "notes.txt\n"


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "/a", "..\\a", "a\nb", "a\0", MARK, 3, None])
def test_marker_file_may_list_only_plain_file_names(name):
    assert not is_bare(name)
    assert is_bare("way.csv")


def test_truncated_marker_file_does_not_prevent_a_new_run(place):
    (place / "out").mkdir()
    (place / "out" / f".{MARK}.1a2b3c4d.part").write_text(HEAD)
    with results(place / "out"):
        write_json(place / "out" / "metrics.json", {})
    assert {path.name for path in (place / "out").iterdir()} == {MARK, "metrics.json"}


def test_empty_marker_file_permits_writing_to_a_results_folder(call, place):
    full(place / "old")
    arguments = ("run", "circle", *BICYCLE, "--no-rrd", "--out", "old")
    status, _, err = call(*arguments)
    assert status == 2
    command = err.strip().rpartition("into this one with: ")[2]
    assert command == "touch old/.agrobot-mj"
    (place / "old" / MARK).touch()
    assert call(*arguments)[0] == 0
    assert json.loads((place / "old/metrics.json").read_text())["outcome"] == "completed"
    assert (place / "old/notes.txt").read_bytes() == b"mine"
    (place / "old/later.csv").write_text("mine")
    with pytest.raises(ScenarioError, match=r"later.csv was not written"):
        write_json(place / "old/later.csv", {})


def test_data_file_does_not_replace_another_file_of_its_name(call, sources, place):
    assert call("run", sources / "way.toml", *BICYCLE, "--no-rrd", "--out", "out")[0] == 0
    assert call("run", sources / "way.toml", *BICYCLE, "--no-rrd", "--out", "out")[0] == 0
    claim(place / "other", ())
    (place / "other/way.csv").write_text("x_m,y_m\n0,0\n9,0\n")
    status, _, err = call("run", sources / "way.toml", *BICYCLE, "--no-rrd", "--out", "other")
    assert refused(status, err)
    assert (place / "other/way.csv").read_text() == "x_m,y_m\n0,0\n9,0\n"


def test_recording_from_python_keeps_other_files(place):
    full(place)
    (place / RECORDING).unlink()
    before = contents(place)
    run(load_scenario("circle", {"duration_s": 0.2, "plant.kind": "bicycle"}), (Recording(Path(RECORDING)),))
    assert {path: content for path, content in contents(place).items() if path != place / RECORDING} == before
    with pytest.raises(ScenarioError, match=r"metrics.json was not written by agrobot-mj"):
        write_log(run(load_scenario("circle", {"duration_s": 0.2, "plant.kind": "bicycle"})), place)
    assert contents(place).items() >= before.items()


def test_every_written_file_is_listed_in_the_folder_marker(place):
    claim(place / "ours", ())
    with atomic(place / "ours" / "a.txt") as part:
        part.write_text("new")
    with atomic(place / "ours" / "a.txt") as part:
        part.write_text("newer")
    assert (place / "ours" / MARK).read_text() == f"{HEAD}\na.txt\n"


# --- sweeps -------------------------------------------------------------------------------------------------------


def rows(folder):
    return sorted(path.name for path in Path(folder, "rows").rglob("*.json"))


def test_fresh_option_deletes_only_files_of_the_sweep(call, sources, place):
    command = ("sweep", sources / "small.toml", "--jobs", 1, "--out", "out", "--quiet")
    assert call(*command)[0] == 0
    for name in ("rows/mine.csv", "rows/00000/notes.txt", "runs/mine/metrics.json", "runs/00000001/notes.txt"):
        (place / "out" / name).parent.mkdir(parents=True, exist_ok=True)
        (place / "out" / name).write_text("mine")
    old = row_file("out", 1).stat().st_mtime_ns
    assert call(*command, "--fresh")[0] == 0
    assert row_file("out", 1).stat().st_mtime_ns > old
    for name in ("rows/mine.csv", "rows/00000/notes.txt", "runs/mine/metrics.json", "runs/00000001/notes.txt"):
        assert (place / "out" / name).read_text() == "mine"


@pytest.mark.parametrize("torn", ["{", "{}", "[]", '{"of": {}, "runs": 4, "files": ["../x"]}'])
def test_truncated_sweep_plan_is_reported_and_fresh_option_replaces_it(call, sources, place, torn):
    command = ("sweep", sources / "small.toml", "--jobs", 1, "--out", "out", "--quiet")
    assert call(*command)[0] == 0
    (place / "out/plan.json").write_text(torn)
    status, _, err = call(*command)
    assert refused(status, err)
    assert "--fresh" in err
    assert call(*command, "--fresh")[0] == 0
    assert len(rows("out")) == 4


def test_repeated_sweep_shard_keeps_the_result_rows_of_other_shards(call, sources, place):
    def shard(k, *more):
        return call("sweep", sources / "small.toml", "--jobs", 1, "--shard", f"{k}/2", "--out", "sh", *more)[0]

    assert [shard(1, "--fresh"), shard(2, "--fresh")] == [0, 0]
    assert len(rows("sh")) == 4
    first, second = (row_file(place / "sh", k) for k in (0, 1))
    before, table = (first.stat().st_mtime_ns, second.stat().st_mtime_ns), (place / "sh/sweep.parquet").read_bytes()
    assert shard(2, "--fresh") == 0
    assert first.stat().st_mtime_ns == before[0]
    assert second.stat().st_mtime_ns > before[1]
    assert (place / "sh/sweep.parquet").read_bytes() != table  # other wall times
    assert len(rows("sh")) == 4


def test_foreign_sweep_plan_cannot_write_outside_its_folder(call, sources, place):
    shard = place / "download/a/shard"
    shutil.copytree(sources / "swept", shard)
    (place / "download/bashrc").write_text("EVIL")
    (place / "bashrc").write_text("my own file")
    plan = json.loads((shard / "plan.json").read_text())
    for names in (["../../bashrc"], [str(place / "bashrc")], [".."], [3], "bashrc", [MARK]):
        (shard / "plan.json").write_text(json.dumps({**plan, "files": names}))
        status, _, err = call("sweep", "--merge", shard, "--out", "results/out")
        assert refused(status, err), err
        assert (place / "bashrc").read_text() == "my own file"
        assert not (place / "results/out").exists()


def test_links_in_a_foreign_sweep_shard_are_ignored(call, sources, place):
    shutil.copytree(sources / "swept", "shard")
    (place / "secret").mkdir()
    (place / "secret/metrics.json").write_text("{}")
    Path("shard/runs").mkdir()
    for name in ("a", "b"):
        Path("shard/runs", name).symlink_to(".")
    Path("shard/runs/00000001").symlink_to(place / "secret")
    Path("shard/runs/00000002").mkdir()
    Path("shard/runs/00000002/metrics.json").symlink_to(place / "secret/metrics.json")
    last = row_file("shard", 3)
    last.unlink()
    last.symlink_to(place / "secret/metrics.json")
    last.with_name("0123456789abcdef.json").write_text("{}")
    assert call("sweep", "--merge", "shard", "--out", "out")[0] == 1  # a row is missing
    assert rows("out") == sorted(row_file("out", k).name for k in (0, 1, 2))
    assert not Path("out/runs").exists()
