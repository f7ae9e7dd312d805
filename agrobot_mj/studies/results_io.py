"""Folders of results that are read again: a file that is not as a command has written it is told, by its folder."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agrobot_mj.core.errors import ScenarioError

DAMAGED = (LookupError, ValueError, TypeError, AttributeError, RecursionError)
"""What files give rise to that are not as a command has written them."""


@contextmanager
def reporting_damage(file: Path, done: str) -> Iterator[None]:
    """Read `file` and those beside it within the block. Raises `ScenarioError` that says what cannot be `done`."""
    try:
        yield
    except ScenarioError:
        raise
    except DAMAGED as error:
        what = f"{type(error).__name__}: {error}"
        text = f"{file}: cannot be {done}: it, or a file beside it, is damaged or of something else ({what})"
        raise ScenarioError(text) from error
