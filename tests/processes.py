"""Programs in separate processes that start fast: they are forked from a server that has imported modules.

`bare` forks from a server without this package, with kernels as plain Python, so that each process may use another copy
of the package. `command` and `program` fork from a server with the package. Both are for tests of effects that last
until the end of a process, such as registrations and resource limits. Tests of the start itself, of signals, or of
pools start Python, which takes one to four seconds of processor time.
"""

import atexit
import contextlib
import importlib
import io
import json
import os
import socket
import subprocess
import sys
import tempfile
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import pytest

from agrobot_mj import cli

PLACES = Path(__file__).parent, Path(__file__).parents[1]
LONGEST_S = 600  # Time after which a process is treated as hanging [s]
SERVER = """
import gc, importlib, json, os, runpy, signal, sys
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except ImportError:
        pass  # a library of an extra
gc.freeze()
for line in sys.stdin:
    job = json.loads(line)
    if not (child := os.fork()):
        break
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
else:
    raise SystemExit
signal.alarm(job["limit"])
for number, name in enumerate(job["streams"]):
    os.dup2(os.open(name, os.O_RDWR | os.O_CREAT), number)
os.chdir(job["folder"])
os.environ.clear()
os.environ.update(job["environment"])
sys.path[:0] = ["", *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
exec(job["before"])
kind, what = job["what"]
sys.argv = [what, *job["arguments"]]
if kind == "-c":
    sys.argv[0] = kind
    exec(compile(what, "<string>", "exec"), {"__name__": "__main__"})
elif kind == "-m":
    runpy.run_module(what, run_name="__main__", alter_sys=True)
else:
    sys.path[0] = os.path.dirname(os.path.abspath(what))
    runpy.run_path(what, run_name="__main__")
"""


class Done(NamedTuple):
    """Result of a process, with the attributes of `subprocess.CompletedProcess`."""

    returncode: int
    stdout: str
    stderr: str


class Server:
    """Python that imports `modules`, with further environment variables, and executes programs in forks."""

    def __init__(self, *modules, **variables):
        self.modules, self.variables = modules, variables

    @cached_property
    def process(self):
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        process = subprocess.Popen(
            [sys.executable, "-c", SERVER, *self.modules],
            cwd=tempfile.gettempdir(),
            env={**environment, **self.variables},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        atexit.register(process.communicate)  # the end of its input ends the server
        return process

    def python(self, folder, *arguments, before="", **variables):
        """Run `python` with arguments in a folder, after the code `before`, with further environment variables."""
        first, *others = map(str, arguments)
        what = (first, others.pop(0)) if first in ("-c", "-m") else ("", first)
        with tempfile.TemporaryDirectory() as place:
            streams = [os.devnull, *(str(Path(place) / name) for name in ("stdout", "stderr"))]
            environment = {**os.environ, **self.variables, **variables}
            job = {"what": what, "arguments": others, "folder": str(folder), "before": before}
            job |= {"environment": environment, "streams": streams, "limit": LONGEST_S}
            print(json.dumps(job), file=self.process.stdin, flush=True)
            status = int(self.process.stdout.readline())
            return Done(status, *(Path(file).read_text(encoding="utf-8") for file in streams[1:]))


LIBRARIES = Server(
    *("numba", "mujoco", "numpy", "pandas", "pyarrow.parquet", "pydantic", "typer.main", "rich", "scipy.optimize"),
    *("scipy.signal", "scipy.spatial", "scipy.stats", "gymnasium", "matplotlib.figure", "matplotlib.pyplot", "rerun"),
    *("shapely", "contourpy"),
    NUMBA_DISABLE_JIT="1",
    MPLBACKEND="agg",
)
PACKAGE = Server("agrobot_mj.cli.runs", "agrobot_mj.recording", "driven", PYTHONPATH=os.pathsep.join(map(str, PLACES)))


def bare(folder, *arguments, **variables):
    """Run `python` with arguments in a folder, without compiled kernels."""
    return LIBRARIES.python(folder, *arguments, **variables)


def free_ports():
    """Return two free UDP ports."""
    with socket.socket(type=socket.SOCK_DGRAM) as a, socket.socket(type=socket.SOCK_DGRAM) as b:
        for each in (a, b):
            each.bind(("127.0.0.1", 0))
        return a.getsockname()[1], b.getsockname()[1]


def command(folder, *arguments, before="", **variables):
    """Run `agrobot-mj` with arguments in a folder, where a UserWarning is an error."""
    return _packaged(folder, "-m", "agrobot_mj", *arguments, before=before, **variables)


def in_process(arguments):
    """Run a command in this process, which must succeed. Return its output."""
    output, given = io.StringIO(), sys.argv
    sys.argv = ["agrobot-mj", *arguments]
    try:
        with contextlib.redirect_stdout(output), pytest.raises(SystemExit) as leaving:
            cli.main()
    finally:
        sys.argv = given
    assert not leaving.value.code, arguments
    return output.getvalue()


def omit_figures(patch):
    """Omit the figures of comparisons, which take one second per comparison and are checked by other tests."""
    patch.setattr(importlib.import_module("agrobot_mj.studies.report"), "write_figures", lambda runs, folder: [])


def program(folder, code, *arguments):
    """Write the text of a program to a file in a folder and run the file."""
    file = Path(folder) / "own.py"
    file.write_text(code, encoding="utf-8")
    return script(folder, file, *arguments)


def script(folder, file, *arguments):
    """Run the program of a file with arguments in a folder."""
    return _packaged(folder, file, *arguments)


def _packaged(folder, *arguments, before="", **variables):
    before = f"import warnings\nwarnings.simplefilter('error', UserWarning)\n{before}"
    return PACKAGE.python(folder, *arguments, before=before, **variables)
