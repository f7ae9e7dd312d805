"""The Rerun viewer, on loopback only: beside a live run, for a file, or in the browser."""

import socket
import subprocess
import sys
import time
from pathlib import Path

PORT = 9876
"""Where viewers listen by default."""
WEB_PORT = 9090
"""Where the browser finds the viewer."""
URL = f"rerun+http://127.0.0.1:{PORT}/proxy"
COMMAND = (
    *(sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", str(PORT)),
    *("--hide-welcome-screen", "--expect-data-soon"),
)
PATIENCE_S = 15.0
"""How long a viewer may take to start [s]."""


def view(file: Path, web: bool = False) -> int:
    """Open `file` in the viewer, or serve it to the browser, until that ends; returns the exit status."""
    ways = ("--web-viewer", "--port", "auto", "--web-viewer-port", str(WEB_PORT)) if web else ()
    command = (sys.executable, "-m", "rerun_cli", "--bind", "127.0.0.1", *ways, str(file))
    return subprocess.run(command, check=False).returncode


def open_viewer() -> bool:
    """Start a viewer that outlives the run and wait until it listens; False, said on stderr, if it does not."""
    quiet = subprocess.DEVNULL  # else a pipe from the run would stay open as long as the viewer
    viewer = subprocess.Popen(COMMAND, stdout=quiet, stderr=quiet, start_new_session=True)
    deadline = time.monotonic() + PATIENCE_S
    while not _listens():
        if viewer.poll() is not None or time.monotonic() > deadline:
            print("no Rerun viewer came up: the run goes on without one", file=sys.stderr)
            return False
        time.sleep(0.1)
    return True


def _listens() -> bool:
    try:
        socket.create_connection(("127.0.0.1", PORT), timeout=1.0).close()
    except OSError:
        return False
    return True
