"""Extensions that have been removed from this tree. Core pages still mention their commands and kinds."""

import re
from pathlib import Path

import pytest

from agrobot_mj.cli.app import COMMANDS

ROOT = Path(__file__).parents[1]
SHIPPED = set(re.findall(r'"agrobot_mj\.extensions\.(\w+)\.', (ROOT / "pyproject.toml").read_text(encoding="utf-8")))
REMOVED = sorted(name for name in SHIPPED if not (ROOT / "agrobot_mj" / "extensions" / name).is_dir())
needs_all = pytest.mark.skipif(bool(REMOVED), reason=f"without the extensions {', '.join(REMOVED)}")
"""Mark of a test that compares a page of the core with all commands or kinds of the package."""
REMOVED_PAGES = tuple(f"docs/extensions/{name}" for name in REMOVED)


def is_there(command):
    """Return whether a command exists or must exist. It may be missing only if its extension has been removed."""
    return not REMOVED or command in COMMANDS
