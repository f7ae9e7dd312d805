"""Fixtures of many tests."""

import gc
import json
import os
import sys
from functools import cache
from math import inf

import pytest
import typer.main
from hypothesis import settings
from json_documents import COMMON

from agrobot_mj import __version__, cli
from agrobot_mj.core import identity

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""Before numpy is imported: with tests on every core, threads for small matrices only wait for each other, at the cost
of most of a fit's processor time."""
gc.set_threshold(cli.OBJECTS_PER_COLLECTION)
"""As in a command: else the collection of the tests looks through the modules' objects again and again."""
typer.main.get_command = cache(typer.main.get_command)
"""A command line is made from its functions once, not in each call of it."""
settings.register_profile("same", derandomize=True, deadline=None, database=None, max_examples=50)
settings.register_profile("explore", deadline=None, print_blob=True, max_examples=100)
settings.load_profile("same")
"""Property tests draw the same examples everywhere; `make explore` draws others. A slow machine is no failure."""


def pytest_configure(config):
    """With several workers, each kernel is compiled by one of them."""
    if hasattr(config, "workerinput"):
        from compiling import take_turns

        take_turns()


@pytest.fixture(autouse=True)
def _plugins_of_one_test():
    """Plugins of a test are no part of the identity of later runs, since worker processes would not have them."""
    files = getattr(sys.modules.get("agrobot_mj.scenario.plugins"), "_files", {})
    before = [(known, dict(known)) for known in (identity._plugins, files)]
    yield
    for known, kept in before:
        known.clear()
        known.update(kept)


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """(exit status, stdout, stderr) of a command line of `agrobot-mj`, in an empty folder and in this process alone.

    Without lines of progress, which come by the clock. Workers, which take three seconds of processor time to start,
    are asked for with `--jobs`.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("agrobot_mj.studies.engine.workers.cores", lambda: 1)
    monkeypatch.setattr("agrobot_mj.simulation.progress.BETWEEN_LINES_S", inf)

    def command(*arguments):
        monkeypatch.setattr(sys, "argv", ["agrobot-mj", *map(str, arguments)])
        with pytest.raises(SystemExit) as leaving:
            cli.main()
        output = capsys.readouterr()
        return leaving.value.code or 0, output.out, output.err

    return command


@pytest.fixture
def asked(call):
    """(document, stderr) of a command line with `--json`, whose status the document has."""

    def command(*arguments):
        status, out, err = call(*arguments, "--json")
        found = json.loads(out)
        assert set(found) >= COMMON
        assert (found["command"], found["version"], found["exit_status"]) == (arguments[0], __version__, status)
        assert (found["error"] is None) == (status == 0)
        return found, err

    return command
