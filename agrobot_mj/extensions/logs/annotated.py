"""Writer for TOML text with comments."""

from collections.abc import Mapping
from typing import Any

import tomli_w


def annotated_toml(data: Mapping[str, Any], notes: Mapping[str, str], head: str = "") -> str:
    """Return data as TOML text that starts with the comment `head`. `notes` are comments on values, by `table.key`."""
    lines, table = [f"# {line}".rstrip() for line in head.splitlines()], ""
    for line in tomli_w.dumps(dict(data)).splitlines():
        if line.startswith("["):
            table = line.strip("[]") + "."
        key = table + line.partition(" = ")[0]
        lines.append(f"{line}  # {notes[key]}" if " = " in line and key in notes else line)
    return "\n".join(lines) + "\n"
