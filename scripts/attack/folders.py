"""Folders of results with a file that was changed, lost, or replaced, for the commands that read them."""

import atexit
import contextlib
import random
import shutil
import tempfile
from functools import cache
from pathlib import Path

from commands import SWEEP
from data import bent
from judge import call

BICYCLE = ("--set", "plant.kind=bicycle", "--set", "duration_s=2", "--quiet")
LIMIT = ("--key", "path.speed_m_s", "--range", "1:3", "--until", "xte_rms > 0.5")
MADE: dict[str, tuple[str, ...]] = {
    "run": ("run", "circle", "--out", "run", *BICYCLE),
    "compare": ("compare", "circle", "--controllers", "pd", "--plants", "bicycle", "--out", "compare", *BICYCLE),
    "sweep": ("sweep", "small.toml", "--jobs", "1", "--out", "sweep", "--quiet"),
    "limit": ("limit", "circle", *LIMIT, "--seeds", "1", "--jobs", "1", "--out", "limit", *BICYCLE),
}
"""Commands that make a folder."""
READ: dict[str, tuple[tuple[str, ...], ...]] = {
    "run": (("report", "run"), ("export", "run", "--mcap"), ("identify", "run"), ("replay", "run", "--out", "out")),
    "compare": (("report", "compare"),),
    "sweep": (
        ("report", "sweep"),
        ("importance", "sweep"),
        ("sweep", "--merge", "sweep", "--out", "out"),
        ("sweep", "small.toml", "--jobs", "1", "--out", "sweep"),
    ),
    "limit": (("report", "limit"),),
}
"""Commands that read one, or go on in it."""
AGAIN = ("run", "run/scenario.toml", "--no-rrd", "--out", "out")
CONTENTS = (b"", b"[]", b"{}", b"null", b"3", b'{"a": 1}', b"[" * 3000, b"[{}]", b"\xff\xfe", b'[{"t": "x"}]', b"nan")
"""What takes the place of a file."""


@cache
def results() -> Path:
    """One folder of each kind."""
    place = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    with contextlib.chdir(place):
        Path("small.toml").write_text(SWEEP)
        for arguments in MADE.values():
            if found := call(list(arguments)):
                raise RuntimeError(f"{arguments}: {found}")
    return place


def folders(chance: random.Random) -> str:
    """One file of a folder, wrong in some way, and a command that reads it."""
    shutil.copytree(results(), ".", dirs_exist_ok=True)
    kind = chance.choice(list(MADE))
    file = chance.choice([file for file in sorted(Path(kind).rglob("*")) if file.is_file() and file.suffix != ".png"])
    how = _spoil(chance, file)
    words = list(chance.choice([*READ[kind], AGAIN] if kind == "run" else READ[kind]))
    found = call(words)
    return f"{how} {file}, {words}: {found}" if found else ""


def _spoil(chance: random.Random, file: Path) -> str:
    """Change, empty or remove a file; how."""
    how = chance.choice(["bent", "bent", "replaced", "replaced", "removed", "a folder"])
    if how == "bent":
        file.write_bytes(bent(chance, file.read_bytes(), 3))
    elif how == "replaced":
        file.write_bytes(chance.choice(CONTENTS))
    else:
        file.unlink()
        if how == "a folder":
            file.mkdir()
    return how
