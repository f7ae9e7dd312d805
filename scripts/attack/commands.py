"""Command lines: each command with odd values for its options, options left out, doubled, or of other commands."""

import contextlib
import os
import random
import shutil
import stat
from pathlib import Path

from data import earlier
from judge import call

SWEEP = 'base = "circle"\n[set]\n"plant.kind" = "bicycle"\nduration_s = 0.2\n[axes]\n"path.radius_m" = [8, 10]\n'
BICYCLE = ("--set", "plant.kind=bicycle", "--set", "duration_s=0.5")
COMMANDS: tuple[tuple[str, ...], ...] = (
    ("run", "circle", "--no-rrd", "--out", "out", *BICYCLE),
    ("compare", "circle", "--controllers", "pd", "--plants", "bicycle", "--no-rrd", "--out", "out", *BICYCLE),
    ("compare", "circle", "--variant", "other:path.radius_m=9", "--seeds", "1", "--no-rrd", "--out", "out", *BICYCLE),
    ("explain", "plant.tyre.kind"),
    ("export", "run", "--mcap", "--out", "out"),
    ("identify", "run", "--vehicle", "--share", "0.6", "--from", "0", "--to", "15", "--fit", "front", "--out", "out"),
    ("importance", "run", "--metric", "xte_rms"),
    ("init", "mine"),
    ("limit", "circle", "--key", "speed_m_s", "--range", "1:3", "--until", "xte_rms > 1", "--seeds", "1", *BICYCLE),
    ("link", "straight_line", "--wait", "0.1", "--duration", "0.2", "--pace", "fast", "--no-rrd", *BICYCLE),
    ("list", "--kinds"),
    ("replay", "run", "--by", "steer", "--from", "1", "--to", "3", "--out", "out"),
    ("report", "run"),
    ("rig", "linear", "--out", "out"),
    ("schema",),
    ("snapshot", "run/signals.parquet", "--at", "1", "--tab", "Drive", "--out", "out"),
    ("sweep", "small.toml", "--jobs", "1", "--shard", "1/2", "--max-runs", "9", "--out", "out"),
    ("tune", "circle", "--guidance", "kinematic", "--budget", "8", "--seeds", "1", "--out", "out", *BICYCLE),
    ("view", "run/signals.parquet"),
)
"""Each command as it could be given, short; `ros2` and `validate` are not among them."""
ODD = (
    *("", " ", ".", "..", "-", "--", "nan", "inf", "-inf", "-1", "0", "1e999", "-0.0", "1e-320", "9" * 400, "0x10"),
    *("no/such", "é", "x" * 5000, "x/" * 2000, "[bold]", "\x1b[31m", "a\nb", "%s", "{}", "\ud800", "None", "true"),
    *("1:2", "2:1", ":", "nan:1", "1:1", "0:1e308", "1/0", "0/2", "3/2", "1/2/3", ",", "pd,", "pd,pd", "lqr,nope"),
    *("a=b", "=", "a:", ":=", "a:b=c,d=[", "run", "small.toml", "pipe", "null", "mine.py", "tcp://", "*"),
    *("xte_rms", "__class__", "outcome == 'x'", "1 < 2 <", "lambda: 0", "circle", "{x=1}", "[[[["),
)
"""What nobody means, or means in another place."""
PLACES = (
    "out/é b",
    "out/[bold]",
    "run/signals.parquet",
    "null",
    "null/x",
    "/dev/full/x",
    "x" * 5000,
    "small.toml/x",
    "",
)
"""Folders for `--out` that are none, or are inside those that a command may write into."""
FLAGS = (
    "--quiet",
    "-q",
    "--live",
    "--vehicle",
    "--merge",
    "--fresh",
    "--quick",
    "--kinds",
    "--sweeps",
    "--help",
    "--x",
)
NEEDED = {"link": ("--wait", "--duration")}
"""Options without which a command waits for long."""


def commands(chance: random.Random) -> str:
    """One command line, wrong in one to three ways."""
    shutil.copytree(earlier(), "run")
    Path("small.toml").write_text(SWEEP)
    Path("mine.py").write_text("import agrobot_mj\n")
    _special("pipe", "null")
    words = list(chance.choice(COMMANDS))
    for _ in range(chance.randint(1, 3)):
        _bend(chance, words)
    there = Path("null").exists()
    found = call(words)
    if there and not Path("null").is_char_device():
        return f"{words}: took the place of a device"
    named = words[0] == "init" or any(repr(word) in found for word in words)
    harmless = found.startswith("files outside") and named
    return "" if not found or harmless else f"{[word[:80] for word in words]}: {found}"


def _special(pipe: str, null: str) -> None:
    """A pipe that nobody writes into, and a device that swallows, where the rights suffice: they must stay."""
    os.mkfifo(pipe)
    with contextlib.suppress(PermissionError):
        os.mknod(null, stat.S_IFCHR | 0o666, os.makedev(1, 3))


def _bend(chance: random.Random, words: list[str]) -> None:
    """Change a word, leave a pair out, double one, or add a flag."""
    at = chance.randrange(1, len(words)) if len(words) > 1 else 0
    before = words[at - 1] if at > 1 else ""
    if at == 0 or chance.random() < 0.15:
        words.append(chance.choice(FLAGS if chance.random() < 0.5 else ODD))
    elif before == "--out":
        words[at] = chance.choice(PLACES)
    elif before in NEEDED.get(words[0], ()):
        words[at] = chance.choice(["nan", "-1", "inf", "é", ""])
    elif not words[at].startswith("--"):
        words[at] = chance.choice(ODD)
    elif words[at] not in ("--out", "--set", "--wait", "--duration"):
        doubled, taken = words[at : at + 2], chance.random() < 0.5
        words[at:] = words[at + 2 :] if taken else [*words[at:], *doubled]
