"""What must never happen, whatever the input: a traceback, a hang, 2 GB, a wrong status, a stray file, silent NaN.

Each input has a process of its own, forked from one that has everything loaded, so that it can neither spoil the next
one nor take the attack with it.
"""

import contextlib
import io
import os
import random
import resource
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from agrobot_mj import cli
from agrobot_mj.control.supervisor import Mode

Attack = Callable[[random.Random], str]
"""Makes one input and says what is wrong with what follows; empty if nothing is."""
FORK = get_context("fork")
LONGEST_S, MOST_KB, LONGEST_TEXT = 60.0, 2_000_000, 10_000
"""Time of an input [s], its memory [kB] and the characters on stderr: more of it is a finding."""
CERTAIN = ("t", "x", "y", "yaw", "speed", "x_ref", "y_ref", "x_hat", "y_hat", "yaw_hat", "steer_ref", "steer")
CERTAIN += ("valve_voltage", "e_lateral")
"""Columns that hold numbers in every row of a run that ended with status 0."""
POWERED, STATE = "pedal_voltage", "supervisor_state"
"""A column that holds numbers but where `STATE` says that the supervisor is stopping the tractor."""
KNOWN = {"out", "runs", "run", "compare", "sweep", "limit"}
"""Folders that commands may write into."""


def judged(attack: Attack, chance: random.Random, limit: float = LONGEST_S) -> str:
    """Run one input in a process and a folder of its own, for `limit` [s]; what is wrong."""
    with tempfile.TemporaryDirectory() as folder:
        ours, theirs = FORK.Pipe(duplex=False)
        child = FORK.Process(target=_attack, args=(attack, chance, folder, theirs))
        child.start()
        theirs.close()
        try:
            found, taken_kb = ours.recv() if ours.poll(limit) else (f"no end within {limit:g} s", 0)
        except EOFError:
            child.join()
            number = -(child.exitcode or 0)
            found, taken_kb = f"ended by {signal.Signals(number).name}" if number > 0 else "the attack itself ended", 0
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid or 0, signal.SIGKILL)  # with what it may have left behind
        child.join()
        return found or (f"took {taken_kb / 1e6:.1f} GB" if taken_kb > MOST_KB else "")


def _attack(attack: Attack, chance: random.Random, folder: str, theirs: Connection) -> None:
    """In the child: the attack, its finding, and the memory [kB] that it took beyond what it began with."""
    began_kb = _peak_kb()
    try:
        os.setpgid(0, 0)
        os.chdir(folder)
        found = attack(chance)
    except BaseException:
        found = traceback.format_exc(limit=-4)
    theirs.send((found[:60_000].encode(errors="replace").decode(), _peak_kb() - began_kb))


def _peak_kb() -> int:
    """Most memory that this process ever held [kB]; reset by a fork, not by an exec."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def call(arguments: list[str], expected: tuple[int, ...] = (0, 1, 2)) -> str:
    """What is wrong with how a command line ends, and the line; empty if nothing is."""
    found = _ended(arguments, expected)
    return f"{[word[:80] for word in arguments]}: {found}" if found else ""


def _ended(arguments: list[str], expected: tuple[int, ...]) -> str:
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
    new = {path.name for path in Path().iterdir()} - before - KNOWN
    if stray := [name for name in new if not any(word.startswith(Path(name).stem) for word in arguments)]:
        return f"files outside --out: {sorted(stray)}"
    return _silent() if status == 0 else ""


def _silent() -> str:
    """Whether signals of a run that ended well hold something that is no number."""
    file = Path("out") / "signals.parquet"
    if not file.is_file():
        return ""
    table = pq.read_table(file)
    bad = [name for name in CERTAIN if not np.isfinite(table[name].to_numpy()).all()]
    unpowered = ~np.isfinite(table[POWERED].to_numpy())
    stopping = table[STATE].to_numpy() == Mode.STOPPING if STATE in table.column_names else False
    if (unpowered & ~np.asarray(stopping)).any():
        bad.append(POWERED)
    return f"status 0, but no numbers in {bad}" if bad else ""
