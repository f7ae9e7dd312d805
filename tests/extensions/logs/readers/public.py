"""Where public recordings are, for tests that read what other programs wrote; nothing of them is in this repository."""

import os
from pathlib import Path

import pytest


def checkout(repository, commit):
    """Folder of a checkout of `owner/name`; the test is skipped without one."""
    variable = "AGROBOT_PUBLIC_LOGS"
    folder = Path(os.environ.get(variable, "")) / repository.partition("/")[2]
    if not os.environ.get(variable) or not folder.is_dir():
        pytest.skip(f"{variable} names no folder with a checkout of github.com/{repository} at {commit}")
    return folder
