"""Page on fields: its file, its command and its program work as printed."""

import re
import shlex
from pathlib import Path

import pytest

pytest.importorskip("shapely")

TEXT = (Path(__file__).parents[3] / "docs" / "extensions" / "fields" / "fields.md").read_text(encoding="utf-8")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the working directory, a folder with the file of the page."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "home.csv").write_text(re.search(r"```csv\n(.*?)```", TEXT, re.S)[1], encoding="utf-8")
    return tmp_path


def test_command_shown_on_the_page_prints_the_documented_field(folder, call):
    (line,) = re.search(r"```sh\n(.*?)```", TEXT, re.S)[1].splitlines()
    status, out, err = call(*shlex.split(line)[1:])
    assert (status, err) == (0, "")
    assert out.startswith("home: 3.")
    assert "problem" not in out
    assert (folder / "runs" / "home" / "map.png").is_file()


def test_program_shown_on_the_page_prints_the_field_area(folder, capsys):
    exec(re.search(r"```python\n(.*?)```", TEXT, re.S)[1], {})
    name, area, notes = capsys.readouterr().out.split()
    assert (name, notes) == ("home", "()")
    assert 30_000 < float(area) < 40_000
