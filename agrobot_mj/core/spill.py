"""Rows of numbers of which only the last are in memory; earlier ones lie in a temporary file.

A run of up to WINDOW rows is in memory as a whole. Beyond that, memory stays as it is: when it is full, the older half
goes to the file as one block, column by column, so that a single column is read back without the others. The file has
no name: it is gone with the process, however that ends. It lies in the folder of `tempfile` (TMPDIR). While that has
no room, memory grows instead, up to MOST_BYTES.
"""

import errno
import os
import sys
import tempfile
from collections.abc import Iterator
from math import prod
from typing import Any

import numpy as np

from agrobot_mj.core.chunked import Chunked
from agrobot_mj.core.signals import Array

WINDOW = 12_000
"""Most rows in memory: ten minutes of 50 ms."""
SPILL = WINDOW // 2
"""Rows in a block of the file."""
_TOLD: set[str] = set()
"""Folders whose lack of room was told."""
MOST_BYTES = 500_000_000
"""Most memory of an array that finds no room on the disk [bytes]: some hours of a run."""


class Spilled:
    """An array of shape (rows, *shape), filled from the front, read by rows as an array is.

    A key is a slice or an array of row numbers, alone or in front of further indices. Rows not written yet are zero, or
    any number.
    """

    def __init__(self, rows: int, shape: tuple[int, ...]) -> None:
        self.shape = (rows, *shape)
        self.recent: Array = np.zeros((min(rows, WINDOW), *shape))
        """The rows in memory, from row `first` on."""
        self.first = 0
        self._width = prod(shape)
        self._file: Any = None
        self._block = SPILL
        """Rows in a block of the file."""

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def nbytes(self) -> int:
        """Size of all rows [bytes]."""
        return 8 * prod(self.shape)

    def room(self, row: int) -> int:
        """Place in `recent` of `row`, the first that is not written yet. Raises as `spill`."""
        if row - self.first == len(self.recent) and row < len(self):
            self.spill()
        return row - self.first

    def spill(self) -> None:
        """Write the oldest block of a full memory to the file, or make memory larger where the disk is full.

        Raises OSError that names the folder once that has grown to its limit.
        """
        folder = tempfile.gettempdir()
        try:
            self._file = self._file or tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - lives as long as this
            self._file.seek(self.first * self._width * 8)
            for column in self.recent[: self._block].reshape(self._block, self._width).T:
                self._file.write(np.ascontiguousarray(column).data)
            self._file.flush()
        except OSError as error:
            if self.recent.nbytes < MOST_BYTES:
                self._grow(folder)
                return
            reason = os.strerror(error.errno or errno.EIO)
            raise OSError(
                error.errno,
                f"{reason}; a run of this length keeps its log there, set TMPDIR to a folder with room",
                folder,
            ) from error
        self.recent[: len(self.recent) - self._block] = self.recent[self._block :]
        self.first += self._block

    def _grow(self, folder: str) -> None:
        """Make room for another block in memory; said once."""
        if folder not in _TOLD:
            _TOLD.add(folder)
            print(f"{folder}: has no room for the log of a long run, which is kept in memory instead", file=sys.stderr)
        self.recent = np.concatenate([self.recent, np.zeros((self._block, *self.shape[1:]))])

    def put(self, at: int, rows: Array) -> None:
        """Write `rows` (n, *shape) from row `at` on, the first that is not written yet. Raises as `spill`."""
        while len(rows):
            begin = self.room(at)
            part = self.recent[begin:][: len(rows)]
            part[:] = rows[: len(part)]
            at, rows = at + len(part), rows[len(part) :]

    def cut(self, rows: int) -> None:
        """Go back to where only `rows` rows were written."""
        if rows < self.first:
            first = rows // self._block * self._block
            self.recent[: rows - first] = self._read(first, rows)
            self.first = first

    def __getitem__(self, key: Any) -> Array:
        """Rows by slice or row numbers, with further indices behind; a view where they are in memory, else a copy.

        Numbers and bounds count from the first row and are not negative, except in a slice.
        """
        rows, *rest = key if isinstance(key, tuple) else (key,)
        if isinstance(rows, slice):
            start, stop, step = rows.indices(len(self))
            if start >= self.first or self.first == 0:
                return self.recent[(slice(start - self.first, max(stop - self.first, 0), step), *rest)]
            if len(rest) == 1 and isinstance(rest[0], int) and len(self.shape) == 2:
                return self._column(start, stop, rest[0])[::step]
            return self._read(start, stop, *rest)[::step]
        numbers = np.asarray(rows)
        least = int(numbers.min(initial=len(self)))
        if least >= self.first:
            return np.asarray(self.recent[(numbers - self.first, *rest)])
        return np.asarray(self._read(least, int(numbers.max()) + 1)[(numbers - least, *rest)])

    def chunked(self, column: int, rows: int) -> Chunked:
        """A column of the first `rows` rows of an array of two dimensions."""
        return Chunked(lambda first, end: self[first:end, column], 0, rows)

    def __setitem__(self, key: Any, value: Any) -> None:
        """Write to rows that are all in memory, by a slice alone or with further indices behind."""
        rows, *rest = key if isinstance(key, tuple) else (key,)
        start, stop, step = rows.indices(len(self))
        if start < self.first:
            raise IndexError(f"rows before {self.first} are no longer in memory")
        self.recent[(slice(start - self.first, stop - self.first, step), *rest)] = value

    def _read(self, start: int, stop: int, *rest: Any) -> Array:
        """Rows `start` to `stop` with further indices, from the file and from memory."""
        found = np.empty((max(stop - start, 0), *self.recent[(slice(0, 0), *rest)].shape[1:]))
        block = np.empty((self._width, self._block))
        for first, begin, end in self._blocks(start, stop):
            self._load(first * self._width * 8, block)
            part = block.T[begin - first : end - first].reshape(end - begin, *self.shape[1:])
            found[begin - start : end - start] = part[(slice(None), *rest)]
        if stop > self.first:
            begin = max(start, self.first)
            found[begin - start :] = self.recent[(slice(begin - self.first, stop - self.first), *rest)]
        return found

    def _column(self, start: int, stop: int, k: int) -> Array:
        """Column `k` of rows `start` to `stop`, without reading the others."""
        found, k = np.empty(max(stop - start, 0)), k % self._width
        for first, begin, end in self._blocks(start, stop):
            self._load((first * self._width + k * self._block + begin - first) * 8, found[begin - start : end - start])
        if stop > self.first:
            begin = max(start, self.first)
            found[begin - start :] = self.recent[begin - self.first : stop - self.first, k]
        return found

    def _blocks(self, start: int, stop: int) -> Iterator[tuple[int, int, int]]:
        """First row of each block of the file with some of the rows `start` to `stop`, and which of them are there."""
        for first in range(start // self._block * self._block, min(stop, self.first), self._block):
            yield first, max(start, first), min(stop, first + self._block)

    def _load(self, at: int, target: Array) -> None:
        """Read the bytes from `at` on into a contiguous array."""
        self._file.seek(at)
        if self._file.readinto(target.data) != target.nbytes:
            raise OSError(errno.EIO, "the temporary file of the log is cut short", tempfile.gettempdir())
