"""The content of the package's sources as a digest, by which results of other code are told apart."""

import hashlib
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
DRIVES = (
    *("core", "machine", "terrain", "tyres", "plants", "sensors", "estimation", "paths", "control", "faults"),
    *("scenario", "metrics", "simulation"),
)
"""Parts of the package that the numbers of a run come from."""


@cache
def source_digest() -> str:
    """16 hex digits of the sources in those parts."""
    digest = hashlib.sha256()
    for part in DRIVES:
        for path in sorted((PACKAGE / part).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
