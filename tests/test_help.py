"""What the help of the commands shows: examples that the command line accepts, and options that mean one thing."""

import shlex
from itertools import pairwise

import pytest
from typer.main import get_command

from agrobot_mj import cli
from agrobot_mj.cli.app import EXAMPLES
from agrobot_mj.cli.options import overrides
from agrobot_mj.core.resources import machine_files
from agrobot_mj.scenario.loading import load_scenario, scenario_files

COMMANDS = get_command(cli.app).commands
ALL = [(name, text) for name, texts in EXAMPLES.items() for text in texts]


def typed(text):
    """The words of an example that the program sees."""
    words = shlex.split(text)
    return words[: words.index(">")] if ">" in words else words


def test_every_command_has_examples_in_its_help(call, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert set(EXAMPLES) == set(COMMANDS)
    for name, texts in EXAMPLES.items():
        _, out, _ = call(name, "--help")
        shown = " ".join(out.partition("Examples:")[2].replace("\\\n", " ").split())
        assert shown == " ".join(f"agrobot-mj {text}" for text in texts)


@pytest.mark.parametrize(("name", "text"), ALL, ids=lambda part: part)
def test_the_command_line_accepts_an_example(name, text):
    verb, *words = typed(text)
    assert verb == name
    context = COMMANDS[name].make_context(name, list(words))
    assert context.args == []
    given = context.params
    machine = {"machine": given["machine"]} if given.get("machine") else {}
    assert set(machine.values()) <= set(machine_files())
    sets = overrides([b for a, b in pairwise(words) if a == "--set"])
    if given.get("source") in scenario_files() or sets or machine:
        load_scenario(given["source"] if given.get("source") in scenario_files() else "straight_line", machine | sets)


@pytest.mark.parametrize("name", ["list", "explain", "init", "schema"])
def test_examples_that_drive_nothing_work(call, monkeypatch, tmp_path, name):
    monkeypatch.chdir(tmp_path)
    for text in EXAMPLES[name]:
        status, out, err = call(*typed(text))
        assert (status, err) == (0, "")
        assert out


@pytest.mark.parametrize("option", ["--out", "--jobs", "--seeds"])
def test_an_option_means_the_same_everywhere(option):
    found = {
        (each.metavar, each.help, each.multiple)
        for command in COMMANDS.values()
        for each in command.params
        if option in each.opts and not each.hidden
    }
    assert len(found) == 1, found


def test_what_an_option_meant_before_names_the_new_one(call, tmp_path):
    where = ("circle", "--key", "path.radius_m", "--range", "6:2", "--until", "xte_rms > 1")
    status, _, err = call("limit", *where, "--seeds", 3)
    assert status == 2
    assert "use --max-seeds" in err
    status, _, err = call("export", tmp_path, "--mcap", "--out", "mine.mcap")
    assert status == 2
    assert err == "--out mine.mcap: names a folder, as for every command; run.mcap is written into it\n"
