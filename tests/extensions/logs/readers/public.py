"""Location of public recordings, for tests that read files of other programs. This repository contains none of them."""

import os
from pathlib import Path

import pytest


def checkout(repository, commit):
    """Return the folder of a checkout of `owner/name`. Without a checkout, the test is skipped."""
    variable = "AGROBOT_PUBLIC_LOGS"
    folder = Path(os.environ.get(variable, "")) / repository.partition("/")[2]
    if not os.environ.get(variable) or not folder.is_dir():
        pytest.skip(f"{variable} names no folder with a checkout of github.com/{repository} at {commit}")
    return folder
