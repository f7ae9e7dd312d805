"""TOML with a comment on some of its lines, for files that people read and change."""

from collections.abc import Mapping
from math import floor, log10
from typing import Any

import tomli_w


def annotated_toml(data: Mapping[str, Any], notes: Mapping[str, str], head: str = "") -> str:
    """Data as TOML; `notes` are comments by `table.key`, `head` stands above, a comment on each line."""
    lines, table = [f"# {line}".rstrip() for line in head.splitlines()], ""
    for line in tomli_w.dumps(dict(data)).splitlines():
        if line.startswith("["):
            table = line.strip("[]") + "."
        key = table + line.partition(" = ")[0]
        lines.append(f"{line}  # {notes[key]}" if " = " in line and key in notes else line)
    return "\n".join(lines) + "\n"


def rounded(value: float, half: float) -> float:
    """A value to the second digit of half its interval; to six digits where it has none."""
    if not 0.0 < half < 1e300:
        return float(f"{value:.6g}")
    return round(value, 1 - floor(log10(half)))
