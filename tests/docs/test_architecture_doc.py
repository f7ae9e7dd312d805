"""The code of docs/architecture.md runs unchanged."""

import re
from pathlib import Path

import pytest

TEXT = (Path(__file__).parents[2] / "docs" / "architecture.md").read_text(encoding="utf-8")
STEPPING, SAVING = re.findall(r"```python\n(.*?)```", TEXT, re.S)


def test_external_law_shown_on_the_page_keeps_the_tractor_on_its_line(capsys):
    exec(STEPPING, {})
    outcome, error = capsys.readouterr().out.split()
    assert outcome == "completed"
    assert float(error) < 0.5


def test_search_example_evaluates_three_commands_from_one_state():
    names = {"Simulation": __import__("agrobot_mj").Simulation}
    exec(SAVING, names)
    assert names["sim"].truth.t == pytest.approx(41 * 0.05)
    assert len(set(names["best"].values())) == 3
