"""Base class of the paths whose geometry is read from a file."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from pydantic import PrivateAttr

from agrobot_mj.core.resources import Stamp, stamp, stamp_of
from agrobot_mj.paths.profile import Timed

Content = TypeVar("Content")


class FromFile(Timed):
    """Base class of paths along lines that are read from a file; subclasses define `file`, `max_bytes` and `course`."""

    reads_file: ClassVar[bool] = True
    """Whether the path reads a file: always true for this class."""
    suffixes: ClassVar[tuple[str, ...]] = ()
    """Accepted extensions of the file name, or an empty tuple for any extension."""
    max_bytes: ClassVar[int]
    """Maximum size of the file [bytes]."""
    if TYPE_CHECKING:
        file: str

    _stamp: Stamp | None = PrivateAttr(default=None)
    """Stamp (path, times of change and size) of the file from which the path geometry was built."""

    def model_post_init(self, context: Any, /) -> None:
        """Record the path, size and change times of the file, without reading its content.

        Two paths with identical scenario keys therefore compare unequal if the file has changed in between.
        """
        self._stamp = stamp(self.file)

    def check(self) -> None:
        """Check the file name and size, then build the path geometry. Raise ValueError if the file is invalid."""
        self.content(lambda _: stamp_of(self.file, self.suffixes, self.max_bytes))
        super().check()

    def content(self, read: Callable[[Stamp], Content]) -> Content:
        """Return the result of the function `read` for the stamp (path, change times and size) of the file. Raise
        ValueError if the file is invalid."""
        try:
            self._stamp = self._stamp or stamp_of(self.file, self.suffixes, self.max_bytes)
            return read(self._stamp)
        except ValueError as error:
            raise ValueError(f"file: {error}") from None
