"""`--json`: one document on stdout whatever the exit status, with the numbers that the text has."""

import json
import re
from pathlib import Path

import pytest

from agrobot_mj import __version__
from agrobot_mj.extensions.bench import datasheet
from agrobot_mj.extensions.bench.datasheet import Measured

PAGE = (Path(__file__).parents[3] / "docs" / "index.md").read_text(encoding="utf-8")
COMMON = {"command", "version", "exit_status", "error"}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


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


def documented(verb):
    """The keys of a verb's document that the page names outside parentheses, before any colon."""
    cells = re.search(rf"^\| `{verb}` \| (.*) \|$", PAGE, re.MULTILINE)[1]
    named = [part.partition(":")[0] for part in re.sub(r"\(.*?\)", "", cells).split(";")]
    return {name for part in named for name in re.findall(r"`(\w+)`(?!\.)", part)}


def test_a_data_sheet_has_the_numbers_of_the_text(asked, call, monkeypatch):
    sheet = [Measured("mass", 13912.123456, "kg"), Measured("slope that it climbs", float("nan"), "deg")]
    monkeypatch.setattr(datasheet, "data_sheet", lambda name: iter(sheet))
    found, err = asked("machine", "row_crop")
    assert found["sheet"][0] == {"name": "mass", "value": 13912.1, "unit": "kg"}
    assert found["sheet"][1]["value"] is None
    assert documented("machine") == set(found) - COMMON
    assert err == call("machine", "row_crop")[1]  # as it is measured
    assert " 13910 kg\n" in err
