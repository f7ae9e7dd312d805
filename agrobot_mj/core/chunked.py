"""A long array of numbers that is read chunk by chunk, so that the whole need not be in memory."""

from collections.abc import Callable, Iterator

from agrobot_mj.core.signals import Array

CHUNK = 120_000
"""Most numbers in a chunk: 100 minutes of 50 ms, 1 MB. A run of this length or less is one chunk."""


class Chunked:
    """Numbers of shape (n,), read where they are asked for; a slice of them is one of these, too."""

    def __init__(self, read: Callable[[int, int], Array], start: int, stop: int) -> None:
        """`read(first, end)` answers with the numbers `first` to `end`, which are not to be written to."""
        self._read, self._start, self._stop = read, start, max(start, stop)

    @classmethod
    def of(cls, values: Array) -> "Chunked":
        """Numbers that are in memory, shape (n,)."""
        return cls(lambda first, end: values[first:end], 0, len(values))

    def __len__(self) -> int:
        return self._stop - self._start

    def __getitem__(self, rows: slice) -> "Chunked":
        """The numbers of a slice without a step."""
        start, stop, _ = rows.indices(len(self))
        return Chunked(self._read, self._start + start, self._start + stop)

    def __iter__(self) -> Iterator[Array]:
        """Chunks, one after the other."""
        for first in range(self._start, self._stop, CHUNK):
            yield self._read(first, min(first + CHUNK, self._stop))

    def whole(self) -> Array:
        """All numbers, shape (n,)."""
        return self._read(self._start, self._stop)
