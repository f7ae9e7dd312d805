"""Failures that no input may cause: traceback, hang, 2 GB of memory, wrong status, unexpected file, undetected NaN.

Each input runs in a separate process, which is forked from a process with all modules loaded. An input can thus neither
affect the next input nor end the test.
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
"""Function that runs one input and returns a description of the fault, or an empty string if there is no fault."""
FORK = get_context("fork")
LONGEST_S, MOST_KB, LONGEST_TEXT = 60.0, 2_000_000, 10_000
"""Limits for an input: time [s], memory [kB] and number of characters on stderr. Exceeding a limit is a finding."""
CERTAIN = ("t", "x", "y", "yaw", "speed", "x_ref", "y_ref", "x_hat", "y_hat", "yaw_hat", "steer_ref", "steer")
CERTAIN += ("valve_voltage", "e_lateral")
"""Columns that contain finite numbers in all rows of a run with exit status 0."""
POWERED, STATE = "pedal_voltage", "supervisor_state"
"""Name of a column that is finite unless the supervisor stops the tractor, and name of the column with the state of the
supervisor."""
KNOWN = {"out", "runs", "run", "compare", "sweep", "limit"}  # Folders to which commands may write


def judged(attack: Attack, chance: random.Random, limit: float = LONGEST_S) -> str:
    """Run one input in a separate process and folder, for at most `limit` [s]. Return a description of the fault, or an
    empty text."""
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
            os.killpg(child.pid or 0, signal.SIGKILL)  # also kill processes that the input has started
        child.join()
        return found or (f"took {taken_kb / 1e6:.1f} GB" if taken_kb > MOST_KB else "")


def _attack(attack: Attack, chance: random.Random, folder: str, theirs: Connection) -> None:
    """Run one input in the child process. Send a description of the fault, and the increase of the memory [kB], to the
    parent process."""
    began_kb = _peak_kb()
    try:
        os.setpgid(0, 0)
        os.chdir(folder)
        found = attack(chance)
    except BaseException:
        found = traceback.format_exc(limit=-4)
    theirs.send((found[:60_000].encode(errors="replace").decode(), _peak_kb() - began_kb))


def _peak_kb() -> int:
    """Return the peak memory of this process [kB]. A fork resets the peak, but an exec does not."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def call(arguments: list[str], expected: tuple[int, ...] = (0, 1, 2)) -> str:
    """Run a command line. Return the command line with its fault, or an empty string."""
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
    """Return a description of the fault if the signals of a successful run contain values that are not finite, or an
    empty text."""
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
