"""Reading folders of results: a damaged file is reported with its folder."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agrobot_mj.core.errors import ScenarioError

DAMAGED = (LookupError, ValueError, TypeError, AttributeError, RecursionError)
"""Exceptions raised by damaged files."""


@contextmanager
def reporting_damage(file: Path, done: str) -> Iterator[None]:
    """Report errors of reading `file` within the block as a `ScenarioError` that says what cannot be `done`."""
    try:
        yield
    except ScenarioError:
        raise
    except DAMAGED as error:
        what = f"{type(error).__name__}: {error}"
        text = f"{file}: cannot be {done}: it, or a file beside it, is damaged or of something else ({what})"
        raise ScenarioError(text) from error
