"""Damaged or edited rows of a sweep: they count as missing, or a message gives the remedy."""

import json
import shutil
from functools import partial

import pyarrow.parquet as pq
import pytest
from row_files import row_file

from agrobot_mj.studies.sweep.runner import SweepOptions
from agrobot_mj.studies.sweep.runner import sweep as run_sweep

TEXT = """
base = "circle"
seeds = 5
[set]
duration_s = 1
"plant.kind" = "bicycle"
"""


@pytest.fixture
def call(call):
    return partial(call, "sweep")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the folder of a completed sweep and its file."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "s.toml").write_text(TEXT, encoding="utf-8")
    run_sweep(folder / "s.toml", folder / "out", SweepOptions(jobs=1, quiet=True))
    return folder


def edited(whole, tmp_path, change):
    """Copy the folder of a sweep and change the third row. Return the sweep file of the copy."""
    shutil.copytree(whole, tmp_path / "copy")
    row = row_file(tmp_path / "copy" / "out", 2)
    content = json.loads(row.read_text(encoding="utf-8"))
    change(content)
    row.write_text(json.dumps(content), encoding="utf-8")
    return tmp_path / "copy" / "s.toml"


@pytest.mark.parametrize(
    ("key", "value"),
    [("xte_rms", [0.3, 0.4]), ("lateral_rms", "0.2"), ("seed", 10**30)],
)
@pytest.mark.parametrize("merged", [True, False])
def test_error_for_a_value_of_the_wrong_type_names_its_file(whole, tmp_path, call, key, value, merged):
    file = edited(whole, tmp_path, lambda row: row.update({key: value}))
    (file.parent / "out" / "sweep.parquet").unlink()
    arguments = ("--merge", file.parent / "out") if merged else (file, "--jobs", "1", "--quiet")
    where = tmp_path / "merged" if merged else file.parent / "out"
    status, _, err = call(*arguments, "--out", where)
    assert status == 2
    assert "Traceback" not in err
    assert f"{row_file(where, 2)}: {key}: " in err
    assert "has a different type than in the other rows; delete the file" in err
    for place in {where, file.parent / "out"}:
        row_file(place, 2).unlink()
    assert call(*arguments, "--out", where)[0] in ((0, 1) if merged else (0,))
    assert len(pq.read_table(where / "sweep.parquet")) == (4 if merged else 5)


@pytest.mark.parametrize(
    "change",
    [
        lambda row: row.pop("expected"),
        lambda row: row.update(expected="yes"),
        lambda row: row.update(outcome=None),
        lambda row: row.clear(),
    ],
)
def test_sweep_run_whose_result_row_has_no_outcome_is_simulated_again(whole, tmp_path, call, change):
    file = edited(whole, tmp_path, change)
    status, out, err = call(file, "--jobs", "1", "--out", file.parent / "out", "--quiet")
    assert (status, "Traceback" in err) == (0, False), err
    row = json.loads(row_file(file.parent / "out", 2).read_text(encoding="utf-8"))
    assert (row["outcome"], row["expected"]) == ("completed", True)
