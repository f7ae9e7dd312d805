"""Destination of a recording: a file, a viewer, or both. The file is readable at any time.

Rerun writes in the background without reporting errors, and a file that ends within a chunk cannot be opened. Each
flush therefore waits until the file is written. If a flush fails, for example on a full disk, the file is truncated to
the end of the previous flush.
"""

import ctypes
import errno
import os
import shutil
import sys
import time
from functools import cache
from pathlib import Path

import rerun as rr

from agrobot_mj.recording.transport.mending import ends_well
from agrobot_mj.recording.transport.viewer import URL, open_viewer
from agrobot_mj.simulation.results import claim, owned_files, remove

try:
    import resource
except ImportError:  # pragma: no cover - Windows has no file size limits
    resource = None  # type: ignore[assignment]

PATIENCE_S = 5.0  # Time limit for a flush [s], a thousand times the duration of a normal flush
LAST_WORDS_S = 0.5  # Delay after a failed flush before the file is truncated, because Rerun tries again to write [s]
FULL_BYTES = 200_000
"""Free space below which a disk counts as full [bytes]. On a full disk, Rerun writes incomplete chunks without an
error."""
LEAST_BYTES = 10_000
"""Minimum file size limit (`ulimit -f`) that permits a recording [bytes]. Below this limit, Rerun waits forever."""


class Sink:
    """Output of a recording stream to a file, a viewer, or both."""

    def __init__(self, stream: rr.RecordingStream, path: Path | None, live: bool = False, spare: int = 0) -> None:
        self.stream, self.path, self.live, self.whole, self.spare = stream, path, live, 0, spare
        sinks: list[rr.FileSink | rr.GrpcSink] = []
        if path is not None:
            _make(path)
            sinks.append(rr.FileSink(str(path)))
        if live and open_viewer():
            sinks.append(rr.GrpcSink(URL))
        if sinks:
            try:
                stream.set_sinks(*sinks)
            except RuntimeError as error:
                raise OSError(errno.EIO, str(error), str(path)) from None

    def flush(self) -> bool:
        """Write all logged data and return True. If the file cannot grow, print a message to stderr and return
        False."""
        try:
            self.stream.flush(timeout_sec=PATIENCE_S)
        except RuntimeError:
            full = self.path is not None and shutil.disk_usage(self.path.parent).free < FULL_BYTES
            if self.live and not full:
                return True  # the viewer is slow or closed
            self._close_file()
            return False
        if self.path is not None:
            if shutil.disk_usage(self.path.parent).free < self.spare:
                self._close_file()
                return False
            self.whole = self.path.stat().st_size
        return True

    def close(self) -> None:
        """Write the remaining data and the footer, and close the file."""
        if self.path is None or self.flush():
            self.stream.disconnect()
            if self.path is not None and not ends_well(self.path):
                self._close_file()

    def _close_file(self) -> None:
        if self.path is None:
            return
        time.sleep(LAST_WORDS_S)
        if self.whole:
            os.truncate(self.path, self.whole)
            print(f"{self.path}: cannot be extended; check the disk space. The recording ends early", file=sys.stderr)
        else:
            self.path.unlink()
        self.path = None
        abandon(self.stream)


def _make(path: Path) -> None:
    """Create an empty file in place of a link or an earlier recording. Raise OSError if this fails, and `ScenarioError`
    if the folder contains files of other programs."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if owned_files(path.parent) is not None or not any(path.parent.iterdir()):
        claim(path.parent, [path.name])
    if path.exists() and not path.is_file() and not path.is_symlink():  # opening a pipe would block
        raise OSError(errno.EINVAL, "is not a regular file; move it", str(path))
    if resource is not None and 0 <= resource.getrlimit(resource.RLIMIT_FSIZE)[0] < LEAST_BYTES:
        raise OSError(errno.EFBIG, "there is no space for a recording", str(path))
    path.unlink(missing_ok=True)
    path.open("xb").close()  # errors raised by Rerun are not OSError


def is_enabled(stream: rr.RecordingStream, path: Path | None) -> bool:
    """Return whether Rerun is enabled; the environment variable `RERUN` can disable Rerun.

    If Rerun is disabled, print one message to stderr and delete an earlier recording at `path`.
    """
    if rr.is_enabled(stream):
        return True
    if path is not None:
        remove(path.parent, [path.name])
    _report_switched_off()
    return False


@cache
def _report_switched_off() -> None:
    given = os.environ.get("RERUN", "off")
    print(f"RERUN={given}: Rerun is disabled, so no recording is written; unset RERUN to record", file=sys.stderr)


def abandon(stream: rr.RecordingStream) -> None:
    """Keep a stream alive until the process exits, because Rerun may wait forever for a failed writer."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))
    rr.unregister_shutdown()
