"""The Rerun viewer, on loopback only: beside a live run, for a file, or in the browser."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import quote

RERUN = (sys.executable, "-m", "rerun_cli")
PORT = 9876
"""Port on which viewers listen by default."""
URL = f"rerun+http://127.0.0.1:{PORT}/proxy"
COMMAND = (
    *(*RERUN, "--bind", "127.0.0.1", "--port", str(PORT)),
    *("--hide-welcome-screen", "--expect-data-soon"),
)
PATIENCE_S = 15.0
"""Longest start of a viewer [s]."""


def view(file: Path) -> int:
    """Open `file` in the viewer until that is closed; returns its exit status."""
    return subprocess.run((*RERUN, "--bind", "127.0.0.1", "--port", "auto", str(file)), check=False).returncode


def serve(file: Path) -> int:
    """Serve `file` with the viewer to browsers on this machine until interrupted; returns the exit status."""
    port, web = free_port(), free_port()
    data = quote(f"rerun+http://127.0.0.1:{port}/proxy", safe="")
    print(f"http://127.0.0.1:{web}?url={data} (Ctrl-C ends it)", flush=True)
    ports = ("--port", str(port), "--web-viewer-port", str(web))
    command = (*RERUN, "--web-viewer", "--bind", "127.0.0.1", *ports, str(file))
    process = subprocess.Popen(command, env={**os.environ, "RUST_LOG": "error"}, start_new_session=True)
    try:
        return process.wait()
    finally:
        end(process)


def end(process: "subprocess.Popen[bytes]") -> None:
    """End a viewer that leads a session, and the launcher before it."""
    try:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait(timeout=5)
    except ProcessLookupError:
        pass
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def free_port() -> int:
    """A port of loopback that nothing listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


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
