"""Location of public recordings, for tests that read files of other programs. This repository contains none of them."""

import os
from pathlib import Path

import pytest


def checkout(repository, commit):
    """Return the local checkout of the repository `owner/name`. Skip the test if there is none."""
    variable = "AGROBOT_PUBLIC_LOGS"
    folder = Path(os.environ.get(variable, "")) / repository.partition("/")[2]
    if not os.environ.get(variable) or not folder.is_dir():
        pytest.skip(f"{variable} names no folder with a checkout of github.com/{repository} at {commit}")
    return folder
