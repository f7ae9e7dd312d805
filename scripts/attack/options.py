"""Numbers at the border: every option that takes one, with what is none, has no end, or has no room."""

import random
import shutil
from functools import cache
from pathlib import Path
from typing import get_args, get_type_hints

from commands import COMMANDS, SWEEP
from data import earlier
from judge import call
from typer.main import get_command

from agrobot_mj import cli

HUGE = (
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "5e-324",
    "-0.0",
    "0",
    "-1",
    "0.9999999999999999",
    "9" * 400,
    "9" * 5000,
)
"""Texts for a number."""
WAITS = {("link", "--wait"), ("ros2", "--wait"), ("link", "--duration")}
"""Options that may make a command wait as long as they say."""
LONG = ("1e308", "inf", "9" * 400)
SMALL = "--set plant.kind=bicycle --set duration_s=0.2 --out out"
COMBINED = {
    "compare": f"compare circle --plants bicycle --controllers pd --no-rrd {SMALL}",
    "sweep": "sweep small.toml --out out --jobs 1",
    "limit": f"limit circle --key path.speed_m_s --range 1:2 --until xte_rms>1 --seeds 2 --jobs 1 {SMALL}",
    "tune": f"tune circle --guidance stanley --seeds 1 --budget 999999 {SMALL}",
}
"""Studies that are short, or are refused."""
LAWS = "--guidance lqr,stanley"
EXTRAS = {
    "compare": (
        *("--variant <!--<script>:path.radius_m=9", "--variant ../x:path.radius_m=9", "--seeds 3", LAWS),
        *("--seeds 99999999", "--max-runs 1"),
    ),
    "sweep": ("--fresh", "--shard 2/3", "--shard 1/1", "--merge", "--max-runs 1", "--fresh --shard 1/2"),
    "limit": (
        *("--tolerance 1e-300", "--confidence 0.5", "--reliability 1e-9", "--range 1:1e308", LAWS),
        *("--range=-1e308:1e308", "--seeds 1"),
    ),
    "tune": ("--seeds 200000", "--budget 8 --seeds 99999", "--guidance nope", "--jobs 1000000"),
}
"""What is added to them."""


@cache
def numeric() -> tuple[tuple[str, str], ...]:
    """Every command that can be tried, with each of its options that take a number."""
    found = []
    for command in (command for command in cli.app.registered_commands if command.name in BASES):
        options = {option.name: option.opts[0] for option in get_command(cli.app).commands[str(command.name)].params}
        for name, hint in get_type_hints(command.callback, include_extras=True).items():
            taken, *_ = get_args(hint) or (hint,)
            if {int, float} & {taken, *get_args(taken)}:
                found.append((str(command.name), options[name]))
    return tuple(found)


BASES = {words[0]: words for words in COMMANDS}
"""A command line for each command."""


def border(chance: random.Random) -> str:
    """One option of one command with a number that no one means."""
    _prepare()
    name, option = chance.choice(numeric())
    texts = [text for text in HUGE if (name, option) not in WAITS or text not in LONG]
    return _said([*BASES[name], f"{option}={chance.choice(texts)}"])


def studies(chance: random.Random) -> str:
    """A study with up to three more options, and the same or another one again in its folder."""
    _prepare()
    for name in chance.sample(list(COMBINED), 2):
        extras = chance.sample(EXTRAS[name], chance.randint(0, 3))
        words = " ".join([COMBINED[name], *extras]).split()
        if found := _said(words):
            return found
    return ""


def _prepare() -> None:
    shutil.copytree(earlier(), "run")
    Path("small.toml").write_text(SWEEP)


def _said(words: list[str]) -> str:
    """What is wrong with how a command ends."""
    found = call(words)
    return f"{[word[:80] for word in words]}: {found}" if found else ""
