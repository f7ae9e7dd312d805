"""Python processes without this package, with kernels as plain Python, that start fast.

They are forked from a server that has imported the libraries of the package, but not the package. Therefore each
process may use another copy of the package. A separate Python would import the libraries again, which takes three to
four seconds of processor time.
"""

import atexit
import json
import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from importlib.util import cache_from_source
from pathlib import Path

from processes import LONGEST_S, Done

LIBRARIES = (
    *("numba", "mujoco", "numpy", "pandas", "pyarrow.parquet", "pydantic", "typer.main", "rich", "scipy.optimize"),
    *("scipy.signal", "scipy.spatial", "scipy.stats", "gymnasium", "matplotlib.figure", "matplotlib.pyplot", "rerun"),
    *("shapely", "contourpy"),
)
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


@cache
def _server():
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    process = subprocess.Popen(
        [sys.executable, "-c", SERVER, *LIBRARIES],
        cwd=tempfile.gettempdir(),
        env={**environment, "NUMBA_DISABLE_JIT": "1", "MPLBACKEND": "agg"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    atexit.register(process.communicate)  # the end of its input ends the server
    return process


def copy(source, target):
    """Copy a file with its time and, for a module, its bytecode, which otherwise would be compiled again."""
    pairs = [(source, target)]
    if source.suffix == ".py":
        pairs.append(tuple(Path(cache_from_source(path)) for path in pairs[0]))
    for old, new in pairs:
        if old.is_file():
            new.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(old, new)


def python(folder, *arguments, **variables):
    """Run `python` with arguments in a folder, with further environment variables."""
    first, *others = map(str, arguments)
    what = (first, others.pop(0)) if first in ("-c", "-m") else ("", first)
    with tempfile.TemporaryDirectory() as place:
        streams = [os.devnull, *(str(Path(place) / name) for name in ("stdout", "stderr"))]
        environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", **variables}
        job = {"what": what, "arguments": others, "folder": str(folder), "environment": environment}
        print(json.dumps({**job, "streams": streams, "limit": LONGEST_S}), file=_server().stdin, flush=True)
        status = int(_server().stdout.readline())
        return Done(status, *(Path(file).read_text(encoding="utf-8") for file in streams[1:]))
