"""Folders with files of somebody else's, and shards of somebody else's: nothing outside our own files may change."""

import json
import os
import random
import shutil
from pathlib import Path

from commands import COMMANDS, SWEEP
from data import earlier
from folders import results
from judge import call

from agrobot_mj.simulation.ownership import HEAD, MARK
from agrobot_mj.simulation.storage import RECORDING, SET

NAMES = (
    *(name for name in SET if name != "signals.parquet"),
    RECORDING,
    "plan.json",
    "sweep.toml",
    "base.toml",
    "sweep.parquet",
    "way.csv",
    "report.html",
)
NAMES = (*NAMES, "comparison.json", "limit.json", "limit.png", "tuning.json", "curves.parquet", "replay.json")
NAMES = (*NAMES, "vehicle.json", "notes.txt", ".notes.txt.1a2b3c4d.part", "lateral.png", "bicycle-pd", "run.mcap")
INNER = ("rows/00000/00000000.json", "rows/mine.csv", "runs/00000001/metrics.json", "images/mine.png")
PLACED = tuple(w for w in COMMANDS if "--out" in w and w[0] not in ("export", "snapshot", "rig", "tune"))
"""Commands that write into a folder of their own within seconds."""
MORE = {"sweep": (("--fresh",), ("--fresh", "--shard", "2/2"), ())}
LINKS = ("runs", "runs/00000001", "runs/a", "rows", "rows/00000", "rows/00000/00000001.json", "plan.json", "base.toml")


def strangers(chance: random.Random) -> str:
    """A command into a folder that holds some of a stranger's files, or links, with a mark or without one."""
    shutil.copytree(earlier(), "run")
    Path("small.toml").write_text(SWEEP)
    away, out = Path("away"), Path("out")
    _fill(away, NAMES, INNER)
    if linked := chance.random() < 0.3:
        out.mkdir()
        for name in chance.sample(sorted(path.name for path in away.iterdir()), chance.randint(1, 6)):
            (out / name).symlink_to((away / name).resolve())
    else:
        _fill(out, chance.sample(NAMES, chance.randint(1, 8)), chance.sample(INNER, chance.randint(0, 3)))
    if mark := chance.choice(["", "", HEAD, f"{HEAD}\n../away/notes.txt\nrows\nruns"]) if linked else HEAD:
        (out / MARK).write_text(mark)
    words = [word for word in chance.choice(PLACED) if word not in ("--shard", "1/2")]
    words += chance.choice(MORE.get(words[0], ((),)))
    before = _content(away) | ({} if linked else _content(out))
    found = call(words)
    changed = [str(path) for path, content in before.items() if _read(path) != content]
    return found or (f"{words}: changed {changed}" if changed else "")


def shards(chance: random.Random) -> str:
    """Shards of which the plan or a link leads out of them, for `--merge`, for a report, and to go on in."""
    shutil.copytree(results(), ".", dirs_exist_ok=True)
    _fill(Path("away"), NAMES, INNER)
    shard = Path("sweep")
    plan = json.loads((shard / "plan.json").read_text())
    odd = ["../away/notes.txt", str(Path("away/notes.txt").resolve()), "..", "", ".", MARK, "way.csv", 3, None, "a\0"]
    for _ in range(chance.randint(0, 2)):
        plan[chance.choice(["files", "runs", "of"])] = chance.choice(
            [[chance.choice(odd)], chance.choice(odd), {}, [], {"base": []}]
        )
    (shard / "plan.json").write_text(json.dumps(plan))
    for name in chance.sample(LINKS, chance.randint(0, 2)):
        _link(shard / name, chance)
    before = _content(Path("away"))  # a link may have been made through another
    (shard / MARK).write_text(chance.choice(["", HEAD, f"{HEAD}\n../away/notes.txt\nrows\nruns\nplan.json"]))
    words = chance.choice(
        [
            ["sweep", "--merge", "sweep", "--out", "out"],
            ["sweep", "--merge", "sweep"],
            ["sweep", "small.toml", "--jobs", "1", "--out", "sweep", *chance.choice([[], ["--fresh"]])],
            ["report", "sweep"],
        ]
    )
    found = call(words)
    changed = [str(path) for path, content in before.items() if _read(path) != content]
    more = sorted(set(_content(Path("away"))) - set(before))
    return found or (f"{words}: changed {changed}, made {more}" if changed or more else "")


def _link(path: Path, chance: random.Random) -> None:
    """A link in the place of a file or folder: to the stranger's, or to the folder that it lies in."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    same = Path("away").resolve() / Path(*path.parts[1:])
    path.symlink_to(chance.choice([".", str(same), str(Path("away").resolve())]))


def _fill(folder: Path, names: tuple[str, ...] | list[str], inner: tuple[str, ...] | list[str]) -> None:
    for name in (*names, *inner):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"mine: {name}")


def _content(folder: Path) -> dict[Path, bytes | None]:
    files = (Path(top, name) for top, _, names in os.walk(folder) for name in names if name != MARK)
    return {path: _read(path) for path in files}


def _read(path: Path) -> bytes | None:
    return path.read_bytes() if path.is_file() else None
