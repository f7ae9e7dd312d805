"""Command lines with odd options and numbers, and commands that read damaged results."""

import atexit
import contextlib
import os
import random
import shutil
import stat
import tempfile
from functools import cache
from pathlib import Path

from hostile import VALUES, spoil, spoil_parquet
from judge import call

from agrobot_mj.cli.panels import COMMANDS as KNOWN

SWEEP = 'base = "circle"\n[set]\n"plant.kind" = "bicycle"\nduration_s = 0.2\n[axes]\n"path.radius_m" = [8, 10]\n'
BICYCLE = "--set plant.kind=bicycle --set duration_s=0.5"
COMMANDS = [
    line.split()
    for line in f"""
    run circle --no-rrd --out out {BICYCLE}
    compare circle --controllers pd --plants bicycle --no-rrd --out out {BICYCLE}
    compare circle --variant other:path.radius_m=9 --plants bicycle --seeds 1 --no-rrd --out out {BICYCLE}
    explain plant.tyre.kind
    export run --mcap --out out
    init mine
    limit circle --key speed_m_s --range 1:3 --until xte_rms>1 --max-seeds 1 {BICYCLE}
    link straight_line --wait 0.1 --duration 0.2 --pace fast --no-rrd {BICYCLE}
    list --kinds
    report run
    report run --metric xte_rms
    rig linear --out out
    schema
    snapshot run/signals.parquet --at 1 --tab Drive --out out
    sweep small.toml --jobs 1 --shard 1/2 --max-runs 9 --out out
    twin run --only identify --share 0.6 --from 0 --to 15 --fit front --out out
    twin run --only replay --by steer --from 1 --to 3 --out out
    tune circle --guidance kinematic --budget 8 --seeds 1 --out out {BICYCLE}
    view run/signals.parquet
    """.strip().splitlines()
    if line.split()[0] in KNOWN
]
"""Short example command lines of all commands except `ros2` and `validate`."""
FLAGS = (
    *("--quiet", "-q", "--live", "--merge", "--fresh", "--quick", "--json", "--kinds", "--sweeps"),
    *("--help", "--x"),
)
PLACES = (
    *("out/é b", "out/[bold]", "run/signals.parquet", "null", "null/x", "/dev/full/x", "small.toml/x", "x" * 5000),
    "",
)
"""Values of `--out` that are invalid or unusual folder names."""
WAITS = {("link", "--wait"), ("link", "--duration")}
"""Options that determine how long a command waits. The test gives them only values that the command rejects."""
REFUSED = ("nan", "-1", "-inf", "é", "")
LIMIT = "--key path.speed_m_s --range 1:3 --until xte_rms>0.5"
SWEEP_ON = "sweep small.toml --jobs 1 --out sweep"
MADE = {
    "run": "run figure_eight --no-rrd --out run --quiet --set plant.kind=bicycle --set duration_s=20",
    "compare": f"compare circle --controllers pd --plants bicycle --no-rrd --out compare --quiet {BICYCLE}",
    "sweep": f"{SWEEP_ON} --quiet",
    "limit": f"limit circle {LIMIT} --max-seeds 1 --jobs 1 --out limit --quiet {BICYCLE}",
}
MADE = {kind: line for kind, line in MADE.items() if kind in KNOWN}
"""Commands that create a results folder of each kind."""
NEEDED = {"commands": ("run",), "parquet": ("run",), "studies": (), "folders": tuple(MADE)}
"""Kinds of results that each class of inputs needs."""
READ = {
    kind: [line for line in lines if line.split()[0] in KNOWN]
    for kind, lines in {
        "run": ["report run", "export run --mcap", "twin run --only valve", "twin run --only identify --out out"]
        + ["twin run --only replay --out out", "run run/scenario.toml --no-rrd --out out"],
        "compare": ["report compare"],
        "sweep": ["report sweep", "report sweep --metric xte_rms", "sweep --merge sweep --out out", SWEEP_ON],
        "limit": ["report limit"],
    }.items()
    if kind in MADE
}
"""Commands that read or continue a results folder, by kind."""


@cache
def result(kind: str) -> Path:
    """Return a results folder of the given kind. The folder is created at the first call."""
    place = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    with contextlib.chdir(place):
        Path("small.toml").write_text(SWEEP)
        if found := call(MADE[kind].split()):
            raise RuntimeError(found)
    return place / kind


def prepare(name: str) -> None:
    """Create the files that a class of inputs needs in the current folder."""
    Path("small.toml").write_text(SWEEP)
    Path("mine.py").write_text("import agrobot_mj\n")
    for kind in NEEDED[name]:
        shutil.copytree(result(kind), kind)


def commands(chance: random.Random) -> str:
    """Run a command line with one to three errors. The command must not remove a device or a pipe without writer from
    the folder."""
    prepare("commands")
    os.mkfifo("pipe")
    with contextlib.suppress(PermissionError):
        os.mknod("null", stat.S_IFCHR | 0o666, os.makedev(1, 3))
    words, device = list(chance.choice(COMMANDS)), Path("null").exists()
    for _ in range(chance.randint(1, 3)):
        bend(chance, words)
    found = call(words)
    return f"{words}: took the place of a device" if device and not Path("null").is_char_device() else found


def bend(chance: random.Random, words: list[str]) -> None:
    """Change, remove or repeat words of a command line, or add an option without a value."""
    at = chance.randrange(1, len(words)) if len(words) > 1 else 0
    before = words[at - 1] if at > 1 else ""
    if at == 0 or chance.random() < 0.15:
        words.append(chance.choice(FLAGS if chance.random() < 0.5 else VALUES))
    elif before == "--out":
        words[at] = chance.choice(PLACES)
    elif (words[0], before) in WAITS:
        words[at] = chance.choice(REFUSED)
    elif not words[at].startswith("--"):
        words[at] = chance.choice(VALUES)
    elif words[at] not in ("--out", "--set", "--wait", "--duration"):
        doubled, taken = words[at : at + 2], chance.random() < 0.5
        words[at:] = words[at + 2 :] if taken else [*words[at:], *doubled]


EXTRAS = {
    "compare": [
        *("--variant <!--<script>:path.radius_m=9", "--variant ../x:path.radius_m=9", "--seeds 3", "--max-runs 1"),
        *("--seeds 99999999", "--guidance lqr,stanley"),
    ],
    "sweep": ["--fresh", "--shard 2/3", "--shard 1/1", "--merge", "--max-runs 1", "--fresh --shard 1/2"],
    "limit": [
        *("--tolerance 1e-300", "--confidence 0.5", "--reliability 1e-9", "--range 1:1e308", "--max-seeds 2"),
        *("--range=-1e308:1e308", "--guidance lqr,stanley"),
    ],
    "tune": ["--seeds 200000", "--budget 8 --seeds 99999", "--budget 999999", "--guidance nope", "--jobs 1000000"],
}
"""Additional options of studies, by command."""


def studies(chance: random.Random) -> str:
    """Run two studies in the same folder, each with up to three additional options."""
    prepare("studies")
    for words in chance.sample([words for words in COMMANDS if words[0] in EXTRAS], 2):
        extras = chance.sample(EXTRAS[words[0]], chance.randint(0, 3))
        if found := call([*words, *" ".join(extras).split()]):
            return found
    return ""


def folders(chance: random.Random) -> str:
    """Damage one file in a results folder, then run a command that reads the folder."""
    prepare("folders")
    kind = chance.choice(list(READ))
    file = chance.choice([file for file in sorted(Path(kind).rglob("*")) if file.is_file() and file.suffix != ".png"])
    how = spoil(chance, file)
    found = call(chance.choice(READ[kind]).split())
    return f"{how} {file}, {found}" if found else ""


def parquet(chance: random.Random) -> str:
    """Damage the signals of a run, then run a command that reads them."""
    prepare("parquet")
    spoil_parquet(chance, Path("run") / "signals.parquet")
    return call(chance.choice(READ["run"][:-1]).split())
