"""Conversion of user-defined names to valid parts of folder names and entity paths."""

import re
import unicodedata
from collections.abc import Iterable

LONGEST = 60  # Maximum number of characters of a safe name, without the number of a duplicate


def safe_names(names: Iterable[str]) -> list[str]:
    """Return the names reduced to ASCII letters, digits, dots, dashes and underscores, in the same order.

    The results are unique even if case is ignored. Long names are cut to `LONGEST` characters.
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
