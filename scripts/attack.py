"""Hostile inputs against the command line and the stages: what must never happen is a traceback, a hang, or silence.

    python scripts/attack.py [--seed 1] [--inputs 300] [--only toml,overrides,files,nan,kills]

Inputs follow from the seed alone, so that a finding can be seen again: each is printed with its class and number. Each
command runs in a folder of its own, on the bicycle and for half a second. The exit status is 1 if there is a finding.
"""

import argparse
import contextlib
import io
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any

from agrobot_mj import cli, load_scenario, run
from agrobot_mj.core.resources import SCENARIOS
from agrobot_mj.scenario.loading import scenario_files
from agrobot_mj.simulation.loop import Loop

LONGEST_S = 60.0
"""An input that takes longer hangs [s]."""
LONGEST_TEXT = 10_000
"""Characters of stderr that one input may cause."""
SHORT = ("--no-rrd", "--quiet", "--set", "duration_s=0.5", "--set", "plant.kind=bicycle", "--out", "out")
FILES = {"signals.parquet", "metrics.json", "scenario.toml"}
VALUES = (
    *("nan", "inf", "-inf", "0", "-1", "1e308", "5e-324", "-0.0", "1e9", "9" * 5000, "0x" + "f" * 5000, "true", '""'),
    *(
        "[]",
        "{}",
        "[" * 3000,
        '"\\u001b[31m"',
        '"' + "x" * 50_000 + '"',
        "1979-05-27",
        "[1, 2, 3]",
        "{ kind = 1 }",
        "é",
    ),
)
"""Values that no key is meant to have."""
STAGES = {"truth": "plant", "measured": "sensors", "estimate": "estimator", "command": "guidance"}


def call(arguments: list[str]) -> str:
    """What is wrong with how a command line ends; empty if nothing is."""
    out, err, began = io.StringIO(), io.StringIO(), time.monotonic()
    status: object = 0
    sys.argv = ["agrobot-mj", *arguments]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            cli.main()
    except SystemExit as leaving:
        status = leaving.code or 0
    except BaseException:
        return traceback.format_exc(limit=-3)
    if status not in (0, 1, 2):
        return f"exit status {status}"
    if status == 2 and not err.getvalue().strip():
        return "exit status 2 without a word"
    if len(err.getvalue()) > LONGEST_TEXT:
        return f"{len(err.getvalue())} characters on stderr"
    if time.monotonic() - began > LONGEST_S:
        return f"took {time.monotonic() - began:.0f} s"
    if status == 2 and Path("out").exists():
        return "bad input, but a folder is there"
    return "MUJOCO_LOG.TXT was written" if Path("MUJOCO_LOG.TXT").exists() else ""


def keys() -> list[str]:
    """Dotted keys of the default scenario that hold a value."""

    def below(table: dict[str, Any], prefix: str) -> list[str]:
        return [
            found
            for name, value in table.items()
            for found in (below(value, f"{prefix}{name}.") if isinstance(value, dict) else [prefix + name])
        ]

    return below(load_scenario("figure_eight").model_dump(mode="json"), "")


def overrides(chance: random.Random) -> str:
    """One to three keys with odd values."""
    sets = [f"{chance.choice(keys())}={chance.choice(VALUES)}" for _ in range(chance.randint(1, 3))]
    return call(["run", "circle", *SHORT, *(word for text in sets for word in ("--set", text))])


def toml(chance: random.Random) -> str:
    """A scenario of the library with bytes and lines changed."""
    lines = chance.choice(list(scenario_files().values())).read_bytes().split(b"\n")
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(lines))
        line = lines[at]
        key = line.partition(b"=")[0]
        changed = [line[: len(line) // 2], line + line, bytes(chance.randbytes(5)), key + b"= " + odd(chance), b""]
        lines[at] = chance.choice(changed)
    Path("mine.toml").write_bytes(b"\n".join(lines))
    return call(["run", "mine.toml", *SHORT])


def odd(chance: random.Random) -> bytes:
    """An odd value as bytes."""
    return chance.choice(VALUES).encode()


def files(chance: random.Random) -> str:
    """A data file of the library, bent."""
    name, table = chance.choice([("hills.asc", "terrain"), ("waypoints.csv", "path")])
    content = bytearray((SCENARIOS / name).read_bytes())
    for _ in range(chance.randint(1, 20)):
        at = chance.randrange(len(content))
        content[at : at + chance.randint(0, 3)] = chance.choice([b"nan", b"-", b"1e999", b"\xff", b"", b",", b"\n"])
    Path("bent" + name[-4:]).write_bytes(content[: chance.choice([len(content), chance.randrange(len(content))])])
    kind = "heightmap" if table == "terrain" else "waypoints"
    words = [f"{table}.kind={kind}", f"{table}.file=bent{name[-4:]}"]
    return call(["run", "straight_line", *SHORT[:-4], "--out", "out", *(w for text in words for w in ("--set", text))])


def injected(chance: random.Random) -> str:
    """A number that is not finite in one message of one tick: it must be named, or counted as missing."""
    stage, value, at = chance.choice(list(STAGES)), chance.choice([nan, inf, -inf]), chance.randrange(1, 10)
    plant, sense, decide, ticks = chance.choice(["bicycle", "mujoco"]), Loop.sense, Loop.decide, [0]
    changed: list[str] = []

    def spoil(message: Any) -> Any:
        names = [name for name in message._fields if isinstance(getattr(message, name), float)]
        changed.append(chance.choice([name for name in names if isfinite(getattr(message, name)) and name != "t"]))
        return message._replace(**{changed[0]: value})

    def wrapped(loop: Loop) -> Any:
        ticks[0] += 1
        spec = {"measured": type(loop.scenario.sensors), "estimate": type(loop.scenario.estimator)}.get(stage)
        if ticks[0] != at:
            return sense(loop)
        if stage == "truth":
            loop.truth = spoil(loop.truth)
        if spec is None:
            return sense(loop)
        method = "measure" if stage == "measured" else "update"
        whole = getattr(spec, method)
        setattr(spec, method, lambda *a: (lambda found: (found[0], spoil(found[1])))(whole(*a)))
        try:
            return sense(loop)
        finally:
            setattr(spec, method, whole)

    def decided(loop: Loop, *messages: Any) -> Any:
        if stage != "command" or ticks[0] != at:
            return decide(loop, *messages)
        law = type(loop.guidance)
        whole = law.update
        law.update = lambda *a: (lambda found: (found[0], spoil(found[1])))(whole(*a))  # type: ignore[method-assign]
        try:
            return decide(loop, *messages)
        finally:
            law.update = whole  # type: ignore[method-assign]

    Loop.sense, Loop.decide = wrapped, decided  # type: ignore[method-assign]
    try:
        log = run(load_scenario("figure_eight", {"duration_s": 1.0, "plant.kind": plant}))
    except Exception:
        return f"{stage}.{changed}: {traceback.format_exc(limit=-3)}"
    finally:
        Loop.sense, Loop.decide = sense, decide  # type: ignore[method-assign]
    named = log.outcome == "diverged" and STAGES[stage][:5] in log.metrics["stop_reason"]
    healed = log.outcome == "completed" and (stage == "measured" or changed[:1] in UNUSED)
    return "" if named or healed else f"{stage}.{changed} = {value}: {log.outcome}, {log.metrics.get('stop_reason')}"


UNUSED = (["wheel_speed"], ["nis"], ["steer_bias"], ["sideslip"], ["fix_age"], ["position_sigma"], ["nis_mean"])
"""Fields that may be NaN, or that only diagnostics use."""


def kills(chance: random.Random) -> str:
    """A run that is killed at any time, and the same again: whole files, of one run, and nothing else."""
    command = [sys.executable, "-m", "agrobot_mj", "run", "circle", "--set", "duration_s=20", "--out", "out", "--quiet"]
    number = chance.choice([signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        time.sleep(chance.uniform(0.5, 8.0))
        process.send_signal(number)
        words = (process.communicate(timeout=LONGEST_S)[1] or b"").decode(errors="replace")
    names = {path.name for path in Path("out").iterdir()} if Path("out").exists() else set()
    if "Traceback" in words and "agrobot_mj/cli" in words:
        return words
    if number != signal.SIGKILL and names & FILES and not names >= FILES:
        return f"after {number.name} only {sorted(names)}"
    if "metrics.json" in names and not names >= FILES:
        return f"metrics without the rest: {sorted(names)}"
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST_S)
    left = {path.name for path in Path("out").iterdir()} - FILES - {"run.rrd"}
    return f"again: {done.returncode}, {done.stderr}, left {sorted(left)}" if done.returncode or left else ""


CLASSES: dict[str, tuple[Callable[[random.Random], str], float]] = {
    "overrides": (overrides, 0.4),
    "toml": (toml, 0.3),
    "files": (files, 0.2),
    "nan": (injected, 0.09),
    "kills": (kills, 0.01),
}
"""Each class with its share of the inputs."""


def main() -> int:
    """Attack, and tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--inputs", type=int, default=300)
    parser.add_argument("--only", default=",".join(CLASSES))
    given, findings, home = parser.parse_args(), 0, Path.cwd()
    for name in given.only.split(","):
        attack, share = CLASSES[name]
        count, began, before = max(1, round(share * given.inputs)), time.monotonic(), findings
        for k in range(count):
            with tempfile.TemporaryDirectory() as folder:
                os.chdir(folder)
                found = attack(random.Random(f"{given.seed} {name} {k}"))
                os.chdir(home)
            if found:
                findings += 1
                print(f"{name} {k}: {found}", flush=True)
        print(f"{name:10} {count:6} inputs, {findings - before} findings, {time.monotonic() - began:.0f} s", flush=True)
    return int(findings > 0)


if __name__ == "__main__":
    raise SystemExit(main())
