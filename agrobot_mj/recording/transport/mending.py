"""Recordings without an end: their writer was killed, or is still at work.

A whole recording ends with a footer. One that was cut in the middle of a segment does not open at all; Rerun's own
program reads it up to there and writes what it has found.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agrobot_mj.recording.transport.viewer import RERUN

FOOTER, FOOTER_END = b"RRF2FOOT", 32
"""Marker of a complete file's footer, and number of last bytes in which it lies."""


def ends_well(path: Path) -> bool:
    """Return whether a recording has its footer, by which a complete file is recognised."""
    with path.open("rb") as file:
        file.seek(-min(FOOTER_END, path.stat().st_size), os.SEEK_END)
        return FOOTER in file.read()


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Return a recording that opens: `path`, or without an end a mended copy, which is gone after the block.

    The copy lacks at most the segment that was being written. The file itself stays as it is, also where it cannot be
    mended.
    """
    if ends_well(path):
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        command = (*RERUN, "rrd", "optimize", str(path.absolute()), "-o", str(copy))
        done = subprocess.run(command, capture_output=True, check=False)
        mended = done.returncode == 0 and copy.is_file()
        if mended:
            print(f"{path}: has no end, its run was killed or goes on; shown as far as it was written", file=sys.stderr)
        yield copy if mended else path
