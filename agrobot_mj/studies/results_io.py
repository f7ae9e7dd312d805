"""Functions that read results folders. Damaged files, and rows from different code versions, raise `ScenarioError`."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.identity import read_identity

DAMAGED = (LookupError, ValueError, TypeError, AttributeError, RecursionError)


@contextmanager
def reporting_damage(file: Path, done: str) -> Iterator[None]:
    """Convert exceptions due to a damaged `file` to `ScenarioError`; `done` is a participle, as in "cannot be read"."""
    try:
        yield
    except ScenarioError:
        raise
    except DAMAGED as error:
        what = f"{type(error).__name__}: {error}"
        text = f"{file}: cannot be {done}: this file, or one next to it, is damaged or has another type ({what})"
        raise ScenarioError(text) from error


def code_of(rows: Iterable[Mapping[str, Any]], folder: Path) -> str:
    """Return the common code version of all rows as text. Raise `ScenarioError` if the rows have different versions."""
    found = [read_identity(row.get("identity")) for row in rows if row.get("error") is None]
    codes = sorted({identity.code if identity else "unknown" for identity in found})
    if len(codes) > 1:
        raise ScenarioError(
            f"{folder}: the rows come from different code versions ({', '.join(codes)}: plugins, program, libraries), "
            "so they are not compared; run the command that wrote the rows again"
        )
    return f"code {codes[0]}" if codes else "no code"
