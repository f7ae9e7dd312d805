"""Repair of incomplete recordings of a killed or active process.

A complete recording ends with a footer. The viewer cannot open a recording that ends within a chunk, but Rerun's
command-line program can copy its complete chunks.
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
"""Marker in the footer of a complete recording, and size of the last part of the file that contains the marker
[bytes]."""


def ends_well(path: Path) -> bool:
    """Return whether a recording is complete, which is indicated by its footer."""
    with path.open("rb") as file:
        file.seek(-min(FOOTER_END, path.stat().st_size), os.SEEK_END)
        return FOOTER in file.read()


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield the path of a readable recording: `path`, or a temporary repaired copy of an incomplete recording."""
    if ends_well(path):
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        command = (*RERUN, "rrd", "optimize", str(path.absolute()), "-o", str(copy))
        done = subprocess.run(command, capture_output=True, check=False)
        mended = done.returncode == 0 and copy.is_file()
        if mended:
            print(
                f"{path}: the recording is incomplete because the run was killed or is active",
                file=sys.stderr,
            )
        yield copy if mended else path
