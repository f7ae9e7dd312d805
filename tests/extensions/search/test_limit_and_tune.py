"""Commands `limit` and `tune`: resumed searches, runs with errors, and JSON output."""

import json
from pathlib import Path

import pytest
from broken_off import BICYCLE, answer, check_resuming, counted
from json_documents import COMMON, documented

WHERE = ("circle", "--key", "path.radius_m", "--range", "12:6", "--until", "xte_rms > 9")
LIMIT = ("limit", "circle", "--key", "path.radius_m", "--range", "6:2", "--until", "xte_rms > 0.02", "--max-seeds", 3)
LIMIT += ("--guidance", "stanley", *BICYCLE)
TUNE = ("tune", "circle", "--guidance", "stanley", "--cases", "mine.toml", "--budget", 8, *BICYCLE)


@pytest.fixture
def driven(monkeypatch, tmp_path):
    return counted(monkeypatch, tmp_path)


@pytest.mark.parametrize(
    ("command", "name", "most"), [(LIMIT, "limit.json", 5), (TUNE, "tuning.json", 7)], ids=["limit", "tune"]
)
def test_interrupted_limit_or_tuning_search_resumes(call, driven, tmp_path, command, name, most):
    check_resuming(call, driven, tmp_path, command, name, most)


def test_runs_that_raise_errors_count_as_failed_in_a_limit_search(call, driven, tmp_path):
    where = ("--key", "guidance.level", "--range", "0.1:0.9", "--until", "outcome == diverged", "--max-seeds", 2)
    command = ("limit", "circle", "--plugin", "laws.py", "--guidance", "fragile", *where)
    status, _, err = call(*command, "--set", "expected_outcome=completed", *BICYCLE)
    assert (status, err) == (0, "a run raised an error: RuntimeError: level too high (laws.py, line 23)\n")
    (law,) = json.loads((tmp_path / "out" / "limit.json").read_text())["laws"]
    assert law["limit"] == pytest.approx(0.5, abs=0.02)
    assert law["tried"][-1]["outcomes"] == {"error": 2}


def test_gains_whose_run_raises_an_error_have_the_maximum_cost(call, driven, tmp_path):
    command = ("tune", "circle", "--plugin", "laws.py", "--guidance", "fragile", "--cases", "mine.toml", "--budget", 8)
    status, _, err = call(*command, *BICYCLE)
    assert (status, err) == (0, "a run raised an error: RuntimeError: level too high (laws.py, line 23)\n")
    found = json.loads((tmp_path / "out" / "tuning.json").read_text())
    assert found["gains"]["guidance.level"] <= 0.5
    assert max(cost for _, cost in found["trace"][1:]) == 45.0


@pytest.mark.parametrize(("command", "name"), [(LIMIT, "limit.json"), (TUNE, "tuning.json")], ids=["limit", "tune"])
@pytest.mark.slow
def test_limit_and_tuning_results_are_equal_with_one_and_two_processes(call, tmp_path, command, name):
    (tmp_path / "mine.toml").write_text('seeds = 2\n[[training]]\nname = "a"\n[[test]]\nname = "b"\n')
    one, two = (call(*command, "--jobs", jobs, "--out", f"jobs{jobs}") for jobs in (1, 2))
    assert (one[0], two[0]) == (0, 0)
    assert answer(tmp_path / "jobs1", name) == answer(tmp_path / "jobs2", name)


def test_json_output_of_a_limit_search_agrees_with_its_file_and_text(asked, call):
    words = ("limit", *WHERE, "--max-seeds", 1, *BICYCLE)
    found, err = asked(*words)
    assert "path.radius_m = 12: 1 of 1 runs succeed" in err  # each value as it is tried
    written = json.loads(Path("out/limit.json").read_text())
    assert set(found) == COMMON | set(written) | {"folder", "hints"}
    assert documented("limit") == {"folder", "hints"}  # and those of the file
    assert {name: found[name] for name in written} == written
    assert written["laws"][0]["statement"] in call(*words)[1]


def test_error_for_the_former_use_of_an_option_names_the_new_option(call):
    status, _, err = call("limit", *WHERE, "--seeds", 3)
    assert status == 2
    assert "use --max-seeds" in err
