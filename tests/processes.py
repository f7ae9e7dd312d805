"""Programs in separate processes that start fast: they are forked from a server that has imported the package.

The programs are for tests of effects that last until the end of a process, such as registrations and resource limits.
Tests of the start itself, of signals, or of pools start Python, which takes one or two seconds.
"""

import contextlib
import io
import multiprocessing
import os
import runpy
import socket
import sys
import tempfile
import warnings
from multiprocessing.forkserver import ensure_running
from pathlib import Path
from typing import NamedTuple

import pytest

from agrobot_mj import cli

SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(["agrobot_mj.cli.runs", "agrobot_mj.recording", "driven"])

PLACES = Path(__file__).parent, Path(__file__).parents[1]
LONGEST_S = 600  # Time after which a process is treated as hanging [s]


class Done(NamedTuple):
    """Result of a process, with the attributes of `subprocess.CompletedProcess`."""

    returncode: int
    stdout: str
    stderr: str


def free_ports():
    """Return two free UDP ports."""
    with socket.socket(type=socket.SOCK_DGRAM) as a, socket.socket(type=socket.SOCK_DGRAM) as b:
        for each in (a, b):
            each.bind(("127.0.0.1", 0))
        return a.getsockname()[1], b.getsockname()[1]


def command(folder, *arguments, before=None):
    """Run `agrobot-mj` with arguments in a folder, in a process that first calls `before()`."""
    return _done(folder, runpy.run_module, "agrobot_mj", ["agrobot-mj", *arguments], before)


def in_process(arguments):
    """Output of a command that succeeds, in this process."""
    output, given = io.StringIO(), sys.argv
    sys.argv = ["agrobot-mj", *arguments]
    try:
        with contextlib.redirect_stdout(output), pytest.raises(SystemExit) as leaving:
            cli.main()
    finally:
        sys.argv = given
    assert not leaving.value.code, arguments
    return output.getvalue()


def program(folder, code, *arguments):
    """Run the text of a program as a file in a folder."""
    file = Path(folder) / "own.py"
    file.write_text(code, encoding="utf-8")
    return script(folder, file, *arguments)


def script(folder, file, *arguments):
    """Run the program of a file with arguments in a folder."""
    return _done(folder, runpy.run_path, str(file), [str(file), *arguments], None)


def _done(folder, execute, what, arguments, before):
    with pytest.MonkeyPatch.context() as patch:  # modules are searched before the process sets `sys.path`
        patch.setenv("PYTHONPATH", os.pathsep.join(map(str, PLACES)))
        ensure_running()
    with tempfile.TemporaryDirectory() as place:
        streams = [Path(place) / name for name in ("stdout", "stderr")]
        process = SERVER.Process(target=_child, args=(folder, streams, execute, what, arguments, before))
        process.start()
        process.join(LONGEST_S)
        if process.exitcode is None:
            process.kill()
            raise TimeoutError(f"no end within {LONGEST_S} s")
        return Done(process.exitcode, *(file.read_text(encoding="utf-8") for file in streams))


def _child(folder, streams, execute, what, arguments, before):
    for number, file in enumerate(streams, 1):
        os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT), number)
    if before is not None:
        before()
    os.chdir(folder)
    warnings.simplefilter("error", UserWarning)
    sys.path.insert(0, str(folder))
    sys.argv = [str(argument) for argument in arguments]
    execute(what, run_name="__main__")
