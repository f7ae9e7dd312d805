"""Change one input of a study and repeat the command. The results must equal the results in a new folder, and no
unnecessary runs may be simulated.

The changed input is a value, a file named by the scenario or by another input file, a plugin, a module imported by the
plugin, or the folder of all these files.
"""

import json
import os
import random
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
from judge import FORK, call

from agrobot_mj.core import identity
from agrobot_mj.studies.engine.tasks import WALL

ROOT = Path(__file__).parents[2]
LAW = """
import sys
from pathlib import Path
from typing import Literal
sys.path.insert(0, str(Path(__file__).parent))
import helping
from agrobot_mj.control import GuidanceLaw
from agrobot_mj.core.signals import Command

class Bent(GuidanceLaw):
    kind: Literal["bent"] = "bent"

    def update(self, state, situation, dt):
        return None, Command(0.01 + helping.ANGLE, 1.0)
"""
FILES = {
    "law.py": LAW,
    "helping.py": "from deeper import ANGLE\n",
    "deeper.py": "ANGLE = 0.03\n",
    "way.csv": "x_m,y_m\n0,0\n9,0\n20,2\n",
    "mine.toml": """
        duration_s = 0.7
        machine = "parts/machine.toml"
        [plant]
        kind = "bicycle"
        [path]
        kind = "waypoints"
        file = "way.csv"
        [guidance]
        kind = "KIND"
        """,
    "parts/machine.toml": '[tractor]\nmjcf = "body.xml"\n[sensors.gnss]\nsigma_m = 0.02\n',
    "parts/body.xml": (ROOT / "examples" / "own_body.xml").read_text("utf-8"),
    "sweep.toml": 'base = "mine.toml"\nseeds = 2\nkeep = "table"\n[axes]\n"path.speed_m_s" = [0.8, 1.2]\n',
}
STUDIES = {
    "sweep": "sweep sweep.toml",
    "compare": "compare mine.toml --plants bicycle --no-rrd",
    "limit": "limit mine.toml --key path.speed_m_s --range 0.8:1.2 --until xte_rms>0.004 --max-seeds 2",
}
ANSWERS = {"sweep": "sweep.parquet", "compare": "comparison.json", "limit": "limit.json"}


def edited(file: str, pattern: str, replacement: str) -> Callable[[random.Random], None]:
    """Return a function that replaces the first match of a pattern in a file. `NUMBER` stands for a random number."""

    def change(chance: random.Random) -> None:
        text = Path(file).read_text("utf-8")
        new = re.sub(pattern, replacement.replace("NUMBER", f"{chance.uniform(0.04, 0.2):.4f}"), text, count=1)
        if new == text:
            raise RuntimeError(f"{file}: nothing to change at {pattern}")
        Path(file).write_text(new, "utf-8")

    return change


def _moved(chance: random.Random) -> None:
    """Move all files to another folder, and make this folder the current folder."""
    Path("moved").mkdir()
    for path in list(Path().iterdir()):
        if path.name != "moved":
            shutil.move(path, "moved")
    os.chdir("moved")


def _touched(chance: random.Random) -> None:
    for path in Path().rglob("*.*"):
        os.utime(path, (1e9, 1e9))


def _other_library(chance: random.Random) -> None:
    name, real = chance.choice(identity.LIBRARIES), identity._version
    identity._version = lambda each: "0.0.1" if each == name else real(each)
    identity.libraries.cache_clear()


CHANGES: dict[str, tuple[Callable[[random.Random], None], bool]] = {
    "plugin": (edited("law.py", r"0\.01", "NUMBER"), True),
    "module of the plugin": (edited("helping.py", r"\Z", "ANGLE = NUMBER\n"), True),
    "module of that module": (edited("deeper.py", r"0\.03", "NUMBER"), True),
    "route": (edited("way.csv", "20,2", "20,NUMBER"), True),
    "route, as long": (edited("way.csv", "20,2", "20,3"), True),
    "machine": (edited("parts/machine.toml", r"0\.02", "NUMBER"), True),
    "body": (edited("parts/body.xml", r'mass="590\.5"', 'mass="9NUMBER"'), True),
    "scenario": (edited("mine.toml", r"0\.7", "0.8"), True),
    "seeds of the sweep": (edited("sweep.toml", "seeds = 2", "seeds = [2, 5]"), True),
    "more output": (edited("sweep.toml", "table", "signals"), True),
    "library": (_other_library, True),
    "place": (_moved, False),
    "times": (_touched, False),
}
"""Functions that change an input of a study, and whether the runs must be simulated again after the change."""


def changes(chance: random.Random) -> str:
    """Run a study, repeat the command, change one input, and repeat the command in the same and in a new folder."""
    name, what = chance.choice(list(STUDIES)), chance.choice(list(CHANGES))
    kind = "bent" if "plugin" in what or "module" in what else chance.choice(["bent", "stanley"])
    for file, text in FILES.items():
        Path(file).parent.mkdir(exist_ok=True)
        Path(file).write_text(text.replace("KIND", kind), "utf-8")
    change, matters = CHANGES[what]
    command = [*STUDIES[name].split(), "--plugin", "law.py", "--jobs", "1", "--quiet", "--out"]
    if name == "compare":
        command[2:2] = ["--guidance", kind]
    found = _run([*command, "out"]) or _repeated([*command, "out"], False)
    if not found:
        change(chance)
        matters &= not (name != "sweep" and what in ("seeds of the sweep", "more output"))
        found = _repeated([*command, "out"], matters) or _run([*command, "compare"])
    if not found and _answer(Path("out"), name) != _answer(Path("compare"), name):
        found = "rows of earlier input among the results"
    return f"{name}, {what} changed: {found}" if found else ""


def _run(words: list[str]) -> str:
    """Run a command with its plugins in a separate process. Return a description of the fault, or an empty text."""
    sys.dont_write_bytecode = True
    ours, theirs = FORK.Pipe(duplex=False)
    child = FORK.Process(target=lambda: theirs.send(call(words, expected=(0, 1))))
    child.start()
    theirs.close()
    try:
        return str(ours.recv())
    except EOFError:
        return f"{words}: its process ended"
    finally:
        child.join()


def _repeated(words: list[str], again: bool) -> str:
    """Repeat a command that must simulate runs only if `again` is true. Return a description of the fault, or an empty
    text."""
    before = _written()
    if found := _run(words):
        return found
    return "" if (_written() != before) == again else f"rows were {'not ' if again else ''}driven again"


def _written() -> dict[str, int]:
    """Return the time at which the file of each row was written [ns]."""
    return {file.as_posix(): file.stat().st_mtime_ns for file in Path("out", "rows").rglob("*.json")}


def _answer(folder: Path, name: str) -> object:
    """Return the result of a study without its wall times, for comparisons of results."""
    file = folder / ANSWERS[name]
    rows = pq.read_table(file).to_pylist() if file.suffix == ".parquet" else json.loads(file.read_text("utf-8"))
    times = set(WALL) - {"identity"}
    return [{k: v for k, v in row.items() if k not in times} for row in rows] if isinstance(rows, list) else rows
