"""docs/studies.md: its sweep runs, resumes, splits and merges, and its table can be read."""

import contextlib
import io
import re
import shlex
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from removed import REMOVED

from agrobot_mj import cli
from agrobot_mj.core.resources import sweep_files
from agrobot_mj.studies.sweep.schema import SweepFile

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
(SWEEP,) = re.findall(r"```toml\n(.*?)```", TEXT, re.S)
(SCRIPT,) = re.findall(r"```python\n(.*?)```", TEXT, re.S)
COMMANDS = [line for block in re.findall(r"```\n(agrobot-mj.*?)```", TEXT, re.S) for line in block.splitlines()]


SHORT = SWEEP.replace("[set] ", "[set]\nduration_s = 3 ")


@pytest.fixture(scope="module", params=["short", pytest.param("whole", marks=pytest.mark.slow)])
def folder(request, tmp_path_factory):
    """Return a folder in which all commands of the page were run in order, in this process if possible.

    In the short version, runs of the sweep end after 3 s.
    """
    folder, whole = tmp_path_factory.mktemp("studies"), request.param == "whole"
    (folder / "mine.toml").write_text(SWEEP if whole else SHORT, encoding="utf-8")
    said = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(said), pytest.MonkeyPatch.context() as patch:
        for line in COMMANDS:
            words = shlex.split(line)
            quick = [] if (whole and "--jobs" in words) or "--merge" in words else ["--jobs", "1"]
            patch.setattr(sys, "argv", [*words, *quick])
            with pytest.raises(SystemExit) as leaving:
                cli.main()
            assert not leaving.value.code, line
    (folder / "said.txt").write_text(said.getvalue())
    return folder


def test_repeated_sweep_command_starts_no_run(folder):
    assert "0 runs done, 12 already present" in (folder / "said.txt").read_text()


def test_serial_sharded_and_merged_sweeps_give_the_same_table(folder):
    tables = [pq.read_table(folder / name / "sweep.parquet").drop_columns("wall_s") for name in ("speed", "a", "whole")]
    assert tables[0].num_rows == 12
    assert tables[0].equals(tables[1])
    assert tables[0].equals(tables[2])


def test_python_code_on_the_page_reads_the_sweep_table(folder):
    said = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(said):
        exec(SCRIPT, {})
    assert "stanley" in said.getvalue()


@pytest.mark.parametrize(
    ("page", "names"),
    [("studies", set(SweepFile.model_fields) - {"title", "version"}), ("reference/sweeps", set(sweep_files()))],
)
def test_every_sweep_key_and_shipped_sweep_is_named(page, names):
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    named = set(re.findall(r"^\| `(?:\[\[)?([a-z_]+)(?:\]\])?` \|", text, re.M))
    assert named == names or (REMOVED and named > names)
