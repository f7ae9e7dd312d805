"""What must never happen, whatever the input: a traceback, a hang, 2 GB, a wrong status, a stray file, silent NaN.

Each input has a process of its own, forked from one that has everything loaded, so that it can neither spoil the next
one nor take the attack with it.
"""

import contextlib
import io
import os
import random
import resource
import select
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from agrobot_mj import cli

Attack = Callable[[random.Random], str]
"""Makes one input and says what is wrong with what follows; empty if nothing is."""
LONGEST_S = 60.0
"""An input that takes longer hangs [s]."""
MOST_KB = 2_000_000
"""Memory that no input may take [kB]."""
LONGEST_TEXT = 10_000
"""Characters of stderr that one input may cause."""
CERTAIN = ("t", "x", "y", "yaw", "speed", "x_ref", "y_ref", "x_hat", "y_hat", "yaw_hat", "steer_ref", "steer")
CERTAIN = (*CERTAIN, "valve_voltage", "pedal_voltage", "e_lateral")
"""Columns that hold numbers in every row of a run that ended with status 0."""
KNOWN = {"out", "runs", "run", "compare", "sweep", "limit"}
"""Folders that commands may write into."""


def judged(attack: Attack, chance: random.Random, limit: float = LONGEST_S) -> str:
    """Run one input in a process and a folder of its own, for `limit` [s]; what is wrong."""
    with tempfile.TemporaryDirectory() as folder:
        reading, writing = os.pipe()
        sys.stdout.flush()
        child = os.fork()
        if child == 0:
            _attack(attack, chance, folder, reading, writing)
        os.close(writing)
        return _watched(child, reading, limit)


def _attack(attack: Attack, chance: random.Random, folder: str, reading: int, writing: int) -> None:
    """In the child: the attack, its finding into the pipe, and out."""
    found = "the attack itself ended"
    try:
        os.close(reading)
        os.setpgid(0, 0)
        os.chdir(folder)
        found = attack(chance)
    except BaseException:
        found = traceback.format_exc(limit=-4)
    finally:
        os.write(writing, found.encode(errors="replace")[:60_000])
        os._exit(0)


def _watched(child: int, reading: int, limit: float) -> str:
    """In the parent: the finding, or that there is none in time."""
    found, end = b"", time.monotonic() + limit
    with os.fdopen(reading, "rb", buffering=0) as pipe:
        while select.select([pipe], [], [], max(end - time.monotonic(), 0.0))[0]:
            if not (piece := pipe.read(65_536)):
                break
            found += piece
        else:
            os.killpg(child, signal.SIGKILL)
            found = f"no end within {limit:g} s".encode()
    _, status, usage = os.wait4(child, 0)
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)  # what it may have left behind
    if not found and os.WIFSIGNALED(status):
        return f"ended by {signal.Signals(os.WTERMSIG(status)).name}"
    if not found and usage.ru_maxrss > max(MOST_KB, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss):
        return f"took {usage.ru_maxrss / 1e6:.1f} GB"
    return found.decode(errors="replace")


def call(arguments: list[str], expected: tuple[int, ...] = (0, 1, 2)) -> str:
    """What is wrong with how a command line ends; empty if nothing is."""
    out, err, before = io.StringIO(), io.StringIO(), {path.name for path in Path().iterdir()}
    status: object = 0
    sys.argv = ["agrobot-mj", *arguments]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            cli.main()
    except SystemExit as leaving:
        status = leaving.code or 0
    except BaseException:
        return traceback.format_exc(limit=-4)
    said = err.getvalue()
    if status not in expected:
        return f"exit status {status}: {said[:300]}"
    if status == 2 and not said.strip():
        return "exit status 2 without a word"
    if "Traceback" in said or len(said) > LONGEST_TEXT:
        return f"{len(said)} characters on stderr: {said[:1000]}"
    if status == 2 and Path("out").exists() and "out" not in before:
        return "bad input, but a folder is there"
    if stray := {path.name for path in Path().iterdir()} - before - KNOWN:
        return f"files outside --out: {sorted(stray)}"
    return silent() if status == 0 else ""


def silent() -> str:
    """Whether signals of a run that ended well hold something that is no number."""
    file = Path("out") / "signals.parquet"
    if not file.is_file():
        return ""
    table = pq.read_table(file, columns=list(CERTAIN))
    bad = [name for name in CERTAIN if not np.isfinite(table[name].to_numpy()).all()]
    return f"status 0, but no numbers in {bad}" if bad else ""
