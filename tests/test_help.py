"""Help of the commands: valid examples and options with one meaning."""

import re
import shlex
from itertools import pairwise

import pytest
from typer.main import get_command

from agrobot_mj import cli
from agrobot_mj.cli.app import COMMANDS as LISTED
from agrobot_mj.cli.options import overrides
from agrobot_mj.cli.panels import PANELS, split_command
from agrobot_mj.core.resources import machine_files
from agrobot_mj.scenario.loading import load_scenario, scenario_files

COMMANDS = get_command(cli.app).commands
ALL = [(name, text) for name, each in LISTED.items() for text in each.examples]


def typed(text):
    """Return the words of an example that are passed to the program."""
    words = shlex.split(text)
    return words[: words.index(">")] if ">" in words else words


def test_every_command_has_examples_in_its_help(call, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert set(LISTED) == set(COMMANDS)
    for name, each in LISTED.items():
        assert each.examples
        _, out, _ = call(*name.split(), "--help")
        shown = " ".join(out.partition("Examples:")[2].replace("\\\n", " ").split())
        assert shown == " ".join(f"agrobot-mj {text}" for text in each.examples)


@pytest.mark.parametrize(("name", "text"), ALL, ids=lambda part: part)
def test_each_help_example_is_a_valid_command(name, text):
    verb, words = split_command(typed(text))
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
def test_help_examples_without_a_simulation_work(call, monkeypatch, tmp_path, name):
    monkeypatch.chdir(tmp_path)
    for text in LISTED[name].examples:
        status, out, err = call(*typed(text))
        assert (status, err) == (0, "")
        assert out


def listed(text):
    """Return the commands in each panel of a help text."""
    panels = re.findall(r"^(\w[\w ]*):\n((?:  \S.*\n)+)", text, re.M)
    return {
        panel: [re.split("  +", line.strip())[0] for line in lines.splitlines()]
        for panel, lines in panels
        if panel != "Options"
    }


def test_help_lists_basic_commands_in_panels(call, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    _, out, _ = call("--help")
    first = listed(out)
    assert first["Run"] == ["run", "view"]
    assert list(first) == [panel for panel in PANELS if panel in first]
    assert sum(map(len, first.values())) <= 12
    _, out, _ = call("--help-all")
    everything = listed(out)
    assert everything["Run"] == ["run", "view", "snapshot", *(name for name in ("play",) if name in LISTED)]
    assert sorted(name for names in everything.values() for name in names) == sorted(LISTED)
    assert all(set(names) <= set(everything[panel]) for panel, names in first.items())


@pytest.mark.parametrize(
    ("former", "now"), [pair for each in LISTED.values() for pair in each.former.items()], ids=lambda part: part
)
def test_deprecated_command_runs_and_names_its_replacement(call, former, now):
    name, *flags = former.split()
    status, out, err = call(name, "nowhere", *flags)
    notice, _, said = err.partition("\n")
    assert notice == f"{former}: use `agrobot-mj {now}`; this command will be removed in the next version"
    assert (status, out, said) == call(*now.split(), "nowhere")


@pytest.mark.parametrize("option", ["--out", "--jobs", "--seeds"])
def test_each_shared_option_has_the_same_help_in_every_command(option):
    found = {
        (each.metavar, each.help, each.multiple)
        for command in COMMANDS.values()
        for each in command.params
        if option in each.opts
    }
    assert len(found) == 1, found
