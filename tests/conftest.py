"""Fixtures of many tests."""

import sys

import pytest

from agrobot_mj import cli


@pytest.fixture
def call(monkeypatch, capsys):
    """(exit status, stdout, stderr) of a command line of `agrobot-mj`, in this process."""

    def command(*arguments):
        monkeypatch.setattr(sys, "argv", ["agrobot-mj", *map(str, arguments)])
        with pytest.raises(SystemExit) as leaving:
            cli.main()
        output = capsys.readouterr()
        return leaving.value.code or 0, output.out, output.err

    return command
