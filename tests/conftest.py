"""Fixtures for all tests."""

import gc
import json
import os
import signal
import sys
from functools import cache
from math import inf

import pytest
import typer.main
from hypothesis import settings
from json_documents import COMMON
from processes import omit_figures

from agrobot_mj import __version__, cli
from agrobot_mj.core import identity
from agrobot_mj.simulation import stepping

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""Numpy reads this variable when it is imported. With tests on every core, BLAS threads for small matrices would only
wait for each other and take most of the processor time of a fit."""
gc.set_threshold(cli.OBJECTS_PER_COLLECTION)
"""Garbage-collection threshold of commands. With the default threshold, each collection would search all modules."""
typer.main.get_command = cache(typer.main.get_command)
"""Cached command object of the command line, which would otherwise be created for each call."""
settings.register_profile("same", derandomize=True, deadline=None, database=None, max_examples=50)
settings.register_profile("explore", deadline=None, print_blob=True, max_examples=100)
settings.load_profile("same")
"""Property tests use the same examples on all machines and have no time limit. `make explore` uses other examples."""


def pytest_configure(config):
    """Let only one of several worker processes compile each kernel."""
    if hasattr(config, "workerinput"):
        from compiling import take_turns

        take_turns()


def pytest_collection_finish():
    """Exclude modules and collected tests from garbage collections."""
    gc.freeze()


def pytest_unconfigure():
    """Collect garbage once, instead of once per collection of pytest and of the interpreter at exit."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _plugins_of_one_test():
    """Remove the plugins of a test from the identity of later runs, because worker processes do not have them."""
    files = getattr(sys.modules.get("agrobot_mj.scenario.plugins"), "_files", {})
    before = [(known, dict(known)) for known in (identity._plugins, files)]
    yield
    for known, kept in before:
        known.clear()
        known.update(kept)


@pytest.fixture
def interruptible():
    """Let SIGINT raise KeyboardInterrupt, as in a terminal, also in a background job of a shell."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """Return a function that runs a command line of `agrobot-mj` in an empty folder. The function returns exit status,
    stdout and stderr.

    The command runs in this process and prints no progress lines, which depend on the clock. Worker processes, which
    take three seconds of processor time to start, are only started by `--jobs`.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("agrobot_mj.studies.engine.workers.cores", lambda: 1)
    monkeypatch.setattr("agrobot_mj.simulation.progress.BETWEEN_LINES_S", inf)
    monkeypatch.setattr("agrobot_mj.simulation.progress.SILENCE_S", 1e6)

    def command(*arguments):
        monkeypatch.setattr(sys, "argv", ["agrobot-mj", *map(str, arguments)])
        with pytest.raises(SystemExit) as leaving:
            cli.main()
        output = capsys.readouterr()
        return leaving.value.code or 0, output.out, output.err

    return command


@pytest.fixture
def single_ticks(monkeypatch):
    """Perform each tick of a run separately, instead of episodes of compiled ticks."""
    monkeypatch.setattr(stepping, "SHORTEST", inf)


@pytest.fixture
def undrawn(monkeypatch):
    """Omit the figures of comparisons, which take one second per comparison. Other tests check the figures."""
    omit_figures(monkeypatch)


@pytest.fixture
def asked(call):
    """Return a function that runs a command line with `--json`, checks the exit status, and returns the JSON document
    and stderr."""

    def command(*arguments):
        status, out, err = call(*arguments, "--json")
        found = json.loads(out)
        assert set(found) >= COMMON
        assert (found["command"], found["version"], found["exit_status"]) == (arguments[0], __version__, status)
        assert (found["error"] is None) == (status == 0)
        return found, err

    return command
