"""docs/extensions/search/search.md: its limit is reproduced, and all commands of the extension are named."""

import json
import re
import shlex
from pathlib import Path

import pytest
from processes import in_process

from agrobot_mj.extensions.search.commands import COMMANDS

TEXT = (Path(__file__).parents[3] / "docs" / "extensions" / "search" / "search.md").read_text(encoding="utf-8")
(LIMIT,) = re.findall(r"^agrobot-mj (limit .*)$", TEXT, re.M)


@pytest.mark.parametrize("fewer", [("--max-seeds", "3"), pytest.param((), marks=pytest.mark.slow)])
def test_limit_command_of_the_page_gives_a_result_per_law(tmp_path, monkeypatch, fewer):
    monkeypatch.chdir(tmp_path)
    in_process([*shlex.split(LIMIT), "--jobs", "1", *fewer])
    laws = json.loads((tmp_path / "tight" / "limit.json").read_text())["laws"]
    assert [law["law"] for law in laws] == ["stanley", "lqr"]
    assert all(law["verdict"] == "limit" for law in laws)
    assert (tmp_path / "tight" / "limit.png").exists()


def test_every_search_command_is_in_the_table_of_the_page():
    named = re.findall(r"^\| \[`(\w+)`\]\(#[\w-]+\)", TEXT, re.M)
    assert set(named) - {"report"} == {function.__name__ for function in COMMANDS}
