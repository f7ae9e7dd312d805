"""Runs for documentation pages: simulated once, stored, and never plotted with results of other sources."""

import json

import numpy as np
import pytest
import sweeps

from agrobot_mj.control.base import YAW_COLUMNS

TRIAL = ("--variant", "pd", "--seeds", "1", "--set", "duration_s=0.5")


def study(folder, *options):
    for page, names in {"one": ("standing", "a"), "other": ("standing part", "b")}.items():
        blocks = "".join(f"<!-- {name} -->\nold\n<!-- end of {name} -->\n" for name in names)
        (folder / f"{page}.md").write_text(blocks)
    given = ["--runs", str(folder / "runs"), "--docs", str(folder), *options]
    return sweeps.Study("verb", ["one", "other"], ["part"], None, given)


def test_runs_of_a_parameter_grid_are_computed_once_and_keep_their_signals(tmp_path, monkeypatch):
    pages = study(tmp_path, *TRIAL)
    (row,) = pages.rows("printed", "learning_printed")
    kept = pages.kept("printed", row)
    assert kept.scenario.controller.kind == row["variant"] == "pd"
    assert np.isfinite(kept.column("t")).all()
    for column in YAW_COLUMNS:
        assert kept.column(column.name).shape == kept.column("t").shape
    monkeypatch.setattr(sweeps, "sweep", lambda *given: pytest.fail("what is there is not run again"))
    assert study(tmp_path, "--only-draw").rows("printed") == [row]
    assert study(tmp_path, "--only-draw").rows("another") == []


def test_runs_of_other_source_versions_are_not_plotted(tmp_path):
    pages = study(tmp_path, *TRIAL)
    pages.rows("printed", "learning_printed")
    plan = tmp_path / "runs" / "printed" / "plan.json"
    content = json.loads(plan.read_text())
    content["of"]["program"] = "0" * 16
    plan.write_text(json.dumps(content))
    with pytest.raises(SystemExit, match="another code version"):
        study(tmp_path, "--only-draw").rows("printed")


def test_results_of_custom_jobs_are_computed_only_once(tmp_path):
    done = []

    def square(job):
        done.append(job)
        return {"square": job * job}

    assert study(tmp_path).done("squares", square, [2, 3]) == [{"square": 4}, {"square": 9}]
    assert study(tmp_path, "--only-draw").done("squares", square, [2, 3, 4]) == []
    assert study(tmp_path).done("squares", square, [2, 3, 4])[2] == {"square": 16}
    assert done == [2, 3, 4]


def test_results_page_states_version_and_commit(tmp_path, monkeypatch):
    monkeypatch.setattr(sweeps, "statement", lambda: "Measured with version 4.5.6.")  # also where git is not
    pages = study(tmp_path)
    one, other = pages.pages
    pages.write("part", {"a": ""})
    assert "<!-- a -->\nold\n" in one.read_text()
    assert "Version" not in one.read_text() + other.read_text()
    pages.write("part", {"a": "new", "b": "newer"})
    assert "<!-- a -->\nnew\n" in one.read_text()
    assert "<!-- b -->\nnewer\n" in other.read_text()
    assert "\nMeasured with version 4.5.6. To measure again: `make verb STUDY=part`.\n" in other.read_text()
    with pytest.raises(SystemExit, match="no blocks c"):
        pages.write("part", {"c": "new"})


def test_error_for_an_unknown_part_of_a_page_names_the_part(tmp_path, capsys):
    with pytest.raises(SystemExit):
        study(tmp_path, "parts")
    assert "parts: unknown part (known: part" in capsys.readouterr().err
