"""Array that is filled row by row. A long array is stored in a memory-mapped temporary file.

The file is in the folder of `tempfile` (TMPDIR), has no name, and is deleted when the process ends. By default the
array is stored column by column, so that individual columns can be read. Disk space for the next rows is reserved
before they are written. If the disk is full, an array of at most MOST_BYTES moves to memory.
"""

import errno
import mmap
import os
import sys
import tempfile
from math import prod
from typing import Any

import numpy as np

from agrobot_mj.core.signals import Array

PIECE = 12_000
"""Number of rows for which disk space is reserved at a time: ten minutes in steps of 50 ms. Arrays up to this length
stay in memory."""
MOST_BYTES = 500_000_000  # Maximum size of an array kept in memory if the disk is full, several hours of a run [bytes]
_TOLD: set[str] = set()  # Folders for which a message about missing disk space was printed


class LongArray:
    """Array of shape (rows, *shape). Unwritten rows have undefined values.

    Raises OSError naming the folder if the disk is full and the array is larger than MOST_BYTES.
    """

    def __init__(self, rows: int, shape: tuple[int, ...], by_column: bool = True) -> None:
        self._file: Any = None
        self._columns = prod(shape) if by_column else 1
        self._map: mmap.mmap | None = None
        self._process = os.getpid()
        try:
            self.numbers = self._map_file((rows, *shape)) if rows > PIECE else np.zeros((rows, *shape))
        except OSError as error:
            self.numbers = _in_memory_instead((rows, *shape), error)
        self._room = rows if self._map is None else 0

    def _map_file(self, shape: tuple[int, ...]) -> Array:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as this array
        self._file.truncate(8 * prod(shape))
        self._map = mmap.mmap(self._file.fileno(), 0)
        if hasattr(mmap, "MADV_RANDOM"):  # otherwise Linux maps up to 2 MB per written column
            self._map.madvise(mmap.MADV_RANDOM)
        return np.ndarray(shape, buffer=self._map, order="C" if self._columns == 1 else "F")

    def make_room(self, end: int) -> None:
        """Reserve space for the rows before `end`. Raises OSError naming the folder if disk and memory have no space.

        In a forked process the rows are first copied to a separate file, because both processes map the same file.
        """
        if self._map is not None and self._process != os.getpid():
            self._process, numbers, self._room = os.getpid(), self.numbers, 0
            self.numbers = self._map_file(numbers.shape)
            self.make_room(end)
            self.numbers[: end - 1] = numbers[: end - 1]
        while self._room < min(end, len(self.numbers)):
            self._reserve(min(self._room + PIECE, len(self.numbers)))

    def _reserve(self, end: int) -> None:
        self.release()
        rows, begin = len(self.numbers), self._room
        size = self.numbers.nbytes // rows // self._columns  # of a row in each contiguous part of the file
        try:
            if hasattr(os, "posix_fallocate"):
                for column in range(self._columns):
                    os.posix_fallocate(self._file.fileno(), size * (column * rows + begin), size * (end - begin))
            self._room = end
        except OSError as error:
            numbers = _in_memory_instead(self.numbers.shape, error)
            numbers[:begin] = self.numbers[:begin]
            self.numbers, self._room, self._map, self._file = numbers, rows, None, None

    def release(self) -> None:
        """Free the memory of rows that were read or written, if the array is in a file. The file keeps the values."""
        if self._map is not None and hasattr(mmap, "MADV_DONTNEED"):
            self._map.madvise(mmap.MADV_DONTNEED)


def _in_memory_instead(shape: tuple[int, ...], error: OSError) -> Array:
    folder = tempfile.gettempdir()
    if 8 * prod(shape) > MOST_BYTES:
        reason = os.strerror(error.errno or errno.EIO)
        text = f"{reason}; a long run stores its log in this folder; set TMPDIR to a folder with enough space"
        raise OSError(error.errno, text, folder) from error
    if folder not in _TOLD:
        _TOLD.add(folder)
        print(f"{folder}: there is no space for the log of a long run; the log is kept in memory", file=sys.stderr)
    return np.zeros(shape)
