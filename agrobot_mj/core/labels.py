"""Names that people choose, as parts of folder names and entity paths."""

import re
import unicodedata
from collections.abc import Iterable

LONGEST = 60
"""Characters of a safe name."""


def safe_names(names: Iterable[str]) -> list[str]:
    """Each name in letters and digits of ASCII, dots, dashes and underscores, in their order.

    No two are equal, not even where upper and lower case are the same; a name that is safe already stays.
    """
    found: list[str] = []
    taken: set[str] = set()
    for name in names:
        plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
        base = re.sub(r"[^A-Za-z0-9_.-]+", "_", plain).strip("_.")[:LONGEST] or "unnamed"
        candidate, number = base, 1
        while candidate.lower() in taken:
            number += 1
            candidate = f"{base}-{number}"
        taken.add(candidate.lower())
        found.append(candidate)
    return found
