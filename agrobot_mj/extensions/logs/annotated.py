"""Conversion of a dictionary to TOML text with comments on its values."""

from collections.abc import Mapping
from typing import Any

import tomli_w


def annotated_toml(data: Mapping[str, Any], notes: Mapping[str, str], head: str = "") -> str:
    """Return `data` as TOML text with `head` as a comment at the top. `notes` maps keys of the form `table.key` to
    comments that follow the values."""
    lines, table = [f"# {line}".rstrip() for line in head.splitlines()], ""
    for line in tomli_w.dumps(dict(data)).splitlines():
        if line.startswith("["):
            table = line.strip("[]") + "."
        key = table + line.partition(" = ")[0]
        lines.append(f"{line}  # {notes[key]}" if " = " in line and key in notes else line)
    return "\n".join(lines) + "\n"
