"""Commands that are killed at random times. Their results must be complete or absent, and the next run must clean up.

Requirements on `run`, `compare` and `sweep`: a results folder contains all files of a run, or no file that resembles a
result. The same command then succeeds and leaves no temporary file or process.
"""

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

FILES = {"signals.parquet", "metrics.json", "scenario.toml"}
LONGEST_S = 120.0  # Time in which a command ends after a signal, on a busy machine [s]
STALE = re.compile(r"\..*\.[0-9a-z_]{8}(\.part)?")  # Pattern of the names of temporary files
SWEEP = """
base = "circle"
seeds = 6
[set]
"plant.kind" = "bicycle"
duration_s = 20
[axes]
"path.radius_m" = [8, 10]
"""
COMMANDS = {
    "run circle --no-rrd --set duration_s=60 --set plant.kind=bicycle": "metrics.json",
    "run circle --set duration_s=20": "run.rrd",
    "compare circle --controllers pd,pd_t2fnn --plants bicycle --set duration_s=30": "comparison.json",
    "sweep sweep.toml --jobs 2": "sweep.parquet",
}
"""Command lines that are killed, each with the file that the command writes last."""


def kills(chance: random.Random) -> str:
    """Send a signal to a command at a random time, then repeat the command. Return a description of the fault, or an
    empty text."""
    Path("sweep.toml").write_text(SWEEP)
    line, number = chance.choice(list(COMMANDS)), chance.choice([signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
    command = [sys.executable, "-m", "agrobot_mj", *line.split(), "--quiet", "--out", "out"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True)
    _wait(process, chance)
    process.send_signal(number)
    if number == signal.SIGINT and chance.random() < 0.3:
        time.sleep(chance.uniform(0.0, 0.3))
        process.send_signal(number)
    try:
        words = process.communicate(timeout=LONGEST_S)[1].decode(errors="replace")
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return f"{line}: no end {LONGEST_S:g} s after {number.name}"
    found = left(number, words, process.returncode) or orphans(process.pid)
    found = f"{number.name}: {found}" if found else _again(command, COMMANDS[line])
    return f"{line}: {found}" if found else ""


def _wait(process: "subprocess.Popen[bytes]", chance: random.Random) -> None:
    """Wait until a random time during a command, either shortly after its start or after its first results."""
    if chance.random() < 0.5:
        time.sleep(chance.uniform(0.2, 10.0))
        return
    end = time.monotonic() + 60.0
    while process.poll() is None and time.monotonic() < end and not any(Path().glob("out/**/*")):
        time.sleep(0.005)
    time.sleep(chance.choice([0.0, 0.01, 0.05, 0.5, 2.0]) * chance.random())


def left(number: signal.Signals, words: str, status: int) -> str:
    """Return a description of the fault in the output or the files of a completed command, or an empty text."""
    if "Traceback" in words:
        return words[-2000:]
    if number != signal.SIGKILL and status not in (0, 1, 130, -number):
        return f"status {status}: {words[-300:]}"
    for file in Path("out").rglob("metrics.json"):
        names = {path.name for path in file.parent.iterdir()}
        if not names >= FILES:
            return f"metrics without the rest: {sorted(names)}"
        json.loads(file.read_text())
    return f"left {_stale()}" if _stale() and number != signal.SIGKILL else ""


def _stale() -> list[str]:
    return [str(path) for path in Path("out").rglob(".*") if STALE.fullmatch(path.name)]


def orphans(group: int) -> str:
    """Return a message about processes of an ended command that are still running, except zombies."""
    end = time.monotonic() + 20.0
    while alive := [pid for pid, (of, state) in _processes().items() if of == group and state != "Z"]:
        if time.monotonic() > end:
            os.killpg(group, signal.SIGKILL)
            return f"still running: {alive}"
        time.sleep(0.1)
    return ""


def _processes() -> dict[str, tuple[int, str]]:
    """Return the process group and the state of every process."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        found[stat.parent.name] = int(fields[2]), fields[0]
    return found


def _again(command: list[str], last: str) -> str:
    """Repeat a command in the same folder. Return a description of its fault, or an empty text."""
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=4 * LONGEST_S)
    if done.returncode or _stale() or not (Path("out") / last).is_file():
        return f"again: status {done.returncode}, {done.stderr[-1000:]}, left {_stale()}, of the last file {last}"
    return ""
