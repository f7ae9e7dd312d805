"""`--json`: one document on stdout for any exit status, with the numbers of the text output."""

import json
import os
from pathlib import Path

import pytest
from json_documents import COMMON, documented
from removed import is_there
from typer.main import get_command

from agrobot_mj import cli
from agrobot_mj.cli.answers import _stdout_to_stderr

QUICK = ("--no-rrd", "--set", "duration_s=2", "--set", "plant.kind=bicycle")
VERBS = ("list", "machine", "run", "compare", "limit", "risk", "falsify", "link", "ros2", "twin", "play")
VERBS += ("field show", "field plan", "field run", "field compare")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_json_page_lists_every_command_with_json_output():
    commands = get_command(cli.app).commands
    having = {name for name, command in commands.items() if any("--json" in each.opts for each in command.params)}
    assert having == {name for name in VERBS if is_there(name)}


@pytest.mark.parametrize("what", ["scenarios", "sweeps", "machines"])
def test_json_output_of_list_has_names_and_titles_of_the_text_output(asked, call, what):
    option = () if what == "scenarios" else (f"--{what}",)
    rows = asked("list", *option)[0][what]
    assert [line.split(maxsplit=1) for line in call("list", *option)[1].splitlines()] == [
        [row["name"], row["title"]] for row in rows
    ]
    assert what in documented("list")


def test_json_and_text_output_list_the_same_kinds(asked, call):
    rows = asked("list", "--kinds")[0]["kinds"]
    texts = [" ".join(row.values()).split() for row in rows]
    assert texts == [line.split() for line in call("list", "--kinds")[1].splitlines()]
    assert set(rows[0]) == {"table", "kind", "text"}


def test_json_output_of_a_run_agrees_with_its_files_and_text(asked, call):
    found, err = asked("run", "circle", *QUICK, "--out", "out")
    assert err == ""
    assert found["metrics"] == json.loads(Path("out/metrics.json").read_text())
    of_run = {"scenario", "seed", "outcome", "expected", "folder", "hints", "metrics", "lag", "attribution"}
    assert set(found) == COMMON | of_run
    assert documented("run") >= set(found) - COMMON
    line, parts = call("run", "circle", *QUICK, "--out", "out")[1].splitlines()
    assert line == f"circle: {found['outcome']}, lateral rms {found['metrics']['lateral_rms']:.3f} m, out"
    assert parts == found["attribution"]
    assert parts.startswith(f"{100 * found['metrics']['xte_rms']:.1f} cm cross-track: ")


def test_estimator_consistency_warning_is_in_text_and_json_output(asked, call):
    slope = ("run", "side_slope_10", "--no-rrd", "--set", "duration_s=6", "--set", "physics=fast", "--out", "slope")
    found, _ = asked(*slope)
    warning = f"side_slope_10: {found['metrics']['estimate_warning']}"
    assert "contradicts its covariance" in warning
    assert found["hints"] == [warning]
    assert call(*slope)[1].splitlines()[1:] == [found["attribution"], warning]


def test_json_output_contains_an_unexpected_outcome_and_hints(asked):
    fault = "fault=[{kind='gnss_loss', start_s=9}]"
    found, err = asked("run", "circle", *QUICK, "--set", "expected_outcome=stuck", "--set", fault, "--out", "out")
    assert (found["exit_status"], found["outcome"], found["expected"]) == (1, "completed", False)
    assert err.splitlines() == [*found["hints"], found["error"]]
    assert "expected_outcome is stuck" in found["error"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "circl"), "did you mean 'circle'"),
        (("run", "circle", "--set", "plant.mass_kg=3"), "tractor.mass_kg"),
        (("run", "circle", "--nope"), "No such option: --nope"),
        (("run",), "SCENARIO"),
        (("list", "--jobs", "2"), "--jobs"),
        (("explain", "tractor"), "--json"),
    ],
)
def test_invalid_input_is_reported_in_json_on_stdout_and_as_text_on_stderr(asked, arguments, words):
    found, err = asked(*arguments)
    assert found["exit_status"] == 2
    assert words in found["error"]
    assert found["error"] == err.rstrip("\n")
    assert set(found) == COMMON


def test_interrupted_command_is_reported_in_json(asked, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("agrobot_mj.simulation.run.run", interrupted)
    found, err = asked("run", "circle", *QUICK, "--out", "out")
    assert (found["exit_status"], found["error"]) == (130, "interrupted before the end")
    assert err == "interrupted before the end\n"


def test_json_output_of_a_comparison_has_the_rows_of_its_file(asked, call, undrawn):
    words = ("compare", "circle", "--controllers", "pd,pi", "--plants", "bicycle", *QUICK, "--jobs", 1, "--out", "out")
    found, _ = asked(*words)
    assert found["rows"] == json.loads(Path("out/comparison.json").read_text())
    assert documented("compare") == set(found) - COMMON
    status, text, _ = call(*words)  # resumes
    table = [line.split("|") for line in text.splitlines() if line.startswith("|")]
    heads, _, *lines = [[cell.strip() for cell in line] for line in table]
    assert status == 0
    for row, line in zip(found["rows"], lines, strict=True):
        cells = dict(zip(heads, line, strict=True))
        assert (cells["controller"], cells["xte rms [m]"]) == (row["controller"], f"{row['xte_rms']:.3f}")
        assert cells["lateral MSE [m2]"] == f"{row['lateral_mse']:#.3g}"
    assert "nn 1" not in heads  # no law has a network, and no turn is complete
    told = [line.partition("  ")[0] for line in text.splitlines()[len(table) :]]
    assert told[:3] == ["lateral MSE [m2]", "/ pd", "xte rms [m]"]


def test_quiet_json_command_prints_only_the_json_document(call):
    status, out, err = call("run", "circle", *QUICK, "--out", "out", "--json", "-q")
    assert (status, err) == (0, "")
    assert json.loads(out)["outcome"] == "completed"


def test_text_printed_by_a_plugin_does_not_corrupt_the_json_document(asked):
    Path("loud.py").write_text("print('hello')\n")
    assert asked("list", "--plugin", "loud.py")[0]["scenarios"]


def test_output_of_child_processes_is_written_to_stderr(capfd):
    with _stdout_to_stderr():
        os.system("echo a worker")
        print("this process")
    print("the document")
    out, err = capfd.readouterr()
    assert out == "the document\n"
    assert sorted(err.splitlines()) == ["a worker", "this process"]
