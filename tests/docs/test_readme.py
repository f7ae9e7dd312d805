"""The Python example of the README runs and gives the errors stated there."""

import re
from pathlib import Path

import pytest

TEXT = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def test_python_example_prints_the_errors_stated_in_the_readme(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.S)
    exec(code, {})
    words = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [line[:2] for line in words] == [
        ["side_slope_10", "completed"],
        ["side_slope_10_compensated", "completed"],
    ]
    (given,) = re.findall(r"prints a cross-track error of (\d+) cm without correction and of (\d+) cm", TEXT)
    assert [100 * float(line[2]) for line in words] == pytest.approx([float(each) for each in given], abs=0.5)
