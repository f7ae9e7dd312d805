"""Rerun viewer on the loopback interface: for a live run, for a file, or as a server for browsers."""

import ctypes
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import quote

from agrobot_mj.core.interrupts import held_back


def _launch_command() -> tuple[str, ...]:
    """Return the command that starts Rerun. On Linux the command starts the binary directly, so that the system can end
    the binary together with its parent."""
    spec = find_spec("rerun_cli")
    program = Path(spec.origin).with_name("rerun") if spec and spec.origin else None
    if sys.platform.startswith("linux") and program and program.is_file() and "RERUN_CLI_PATH" not in os.environ:
        return (str(program),)
    return (sys.executable, "-m", "rerun_cli")


RERUN = _launch_command()
PORT = 9876
URL = f"rerun+http://127.0.0.1:{PORT}/proxy"
COMMAND = (*(*RERUN, "--bind", "127.0.0.1", "--port", str(PORT)), *("--hide-welcome-screen", "--expect-data-soon"))
PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None) if sys.platform.startswith("linux") else None
PATIENCE_S = 15.0  # Time limit for the start of a viewer [s]


def view(file: Path) -> int:
    """Open `file` in the viewer, wait until the viewer is closed, and return its exit status."""
    return subprocess.run((*RERUN, "--bind", "127.0.0.1", "--port", "auto", str(file)), check=False).returncode


def serve(file: Path) -> int:
    """Serve a recording to browsers on this computer until interrupted; return the exit status of the server."""
    port, web = free_port(), free_port()
    data = quote(f"rerun+http://127.0.0.1:{port}/proxy", safe="")
    print(f"http://127.0.0.1:{web}?url={data}&theme=dark (press Ctrl-C to end)", flush=True)
    ports = ("--port", str(port), "--web-viewer-port", str(web))
    command = (*RERUN, "--web-viewer", "--bind", "127.0.0.1", *ports, str(file))
    with start_viewer(command, {**os.environ, "RUST_LOG": "error"}) as process:
        return process.wait()


@contextmanager
def start_viewer(
    command: Sequence[str], environment: Mapping[str, str], stdout: int | None = None, stderr: int | None = None
) -> Iterator["subprocess.Popen[bytes]"]:
    """Start a viewer in a separate process session. The viewer ends at the end of the context or of this process."""
    process = None
    try:
        with held_back():  # a signal before the assignment would leave the viewer running
            process = subprocess.Popen(
                command,
                env=environment,
                start_new_session=True,
                preexec_fn=_die_with_parent,
                stdout=stdout,
                stderr=stderr,
            )
        yield process
    finally:
        if process is not None:
            end(process)


def _die_with_parent() -> None:
    """Configure Linux to send SIGTERM to the calling viewer process when its parent process ends."""
    if _LIBC is not None:
        _LIBC.prctl(PR_SET_PDEATHSIG, int(signal.SIGTERM))


def end(process: "subprocess.Popen[bytes]") -> None:
    """Terminate all processes of a viewer session. `process` is the session leader."""
    try:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait(timeout=5)
    except ProcessLookupError:
        pass
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def free_port() -> int:
    """Return a free TCP port on the loopback interface."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def open_viewer() -> bool:
    """Start a viewer that stays open after the run; return whether the viewer accepts connections within
    `PATIENCE_S`."""
    quiet = subprocess.DEVNULL  # the viewer must not keep a pipe of the run open
    viewer = subprocess.Popen(COMMAND, stdout=quiet, stderr=quiet, start_new_session=True)
    deadline = time.monotonic() + PATIENCE_S
    while not _listens():
        if viewer.poll() is not None or time.monotonic() > deadline:
            print("the Rerun viewer did not start; the run continues without it", file=sys.stderr)
            return False
        time.sleep(0.1)
    return True


def _listens() -> bool:
    try:
        socket.create_connection(("127.0.0.1", PORT), timeout=1.0).close()
    except OSError:
        return False
    return True
