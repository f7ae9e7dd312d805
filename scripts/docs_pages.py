"""Documentation pages generated from the code: scenario keys, commands, and Python interface, as Markdown."""

import inspect
from typing import Any

import click
import typer.main

from agrobot_mj.cli import app
from agrobot_mj.cli.app import COMMANDS
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.spec import Spec, members
from agrobot_mj.core.walk import TableClass, places
from agrobot_mj.scenario.reference import document, first_line, usual_kind
from agrobot_mj.scenario.schema import Scenario

BASES = ("core.signals", "control.base", "estimation.base", "terrain.base", "tyres.base", "machine.implements.base")
BASES += ("paths.base", "sensors.base", "faults.base", "metrics.base", "plants.base")
"""Modules with base classes for plugins, and with the messages that they exchange."""
FRONT = ("scenario.loading.load_scenario", "simulation.run.run", "simulation.stepping.Simulation")
FRONT += ("scenario.plugins.register", "simulation.log.Log", "scenario.schema.Scenario", "core.errors")
"""Main functions and classes on the page of the Python interface, as names relative to `agrobot_mj`."""


def keys_page() -> str:
    """Return the page with all keys of a scenario file. Each table and each kind of a table has a section."""
    head = (
        "# Keys of a scenario\n\nThis page lists every key of a scenario file by table, as `agrobot-mj explain KEY` on "
        "the command line. [Models](reference/models.md) lists numbers, ranges and sources, "
        "[scenarios](scenarios.md#how-a-file-reads) describes the files. The key `kind` selects the kind of a table.\n"
    )
    return "\n".join([head, *_sections("", places(Scenario(), []), set())])


def _sections(table: str, found: list[TableClass], seen: set[tuple[str, type[Spec]]]) -> list[str]:
    """Return the sections of a scenario table, one per class that the table can have, and of its nested tables."""
    lines: list[str] = []
    for place in found:
        if (table, place.owner) in seen:
            continue
        seen.add((table, place.owner))
        kind = place.owner.model_fields.get("kind")
        named = f"`[{table}]`" if table else "At the top"
        if kind:
            named += " or".join(f' `kind = "{name}"`' for name in members(place.owner))
        elif len({each.owner for each in found}) > 1:  # distinguished by the kind of a parent table
            named += ' under `{} = "{}"`'.format(*place.kinds[-1])
        usual = ", the default" if kind and kind.default == usual_kind(table) else ""
        lines += [f"## {named}{usual}\n", f"{first_line(place.owner)}\n" if table else "", *_table(place), ""]
    fields = [item for place in found for item in place.owner.model_fields.items()]
    for name in dict.fromkeys(name for name, field in fields if members(field.annotation)):
        dotted = f"{table}.{name}".lstrip(".")
        lines += _sections(dotted, places(Scenario(), dotted.split(".")), seen)
    return lines


def _table(place: TableClass) -> list[str]:
    rows = []
    for name, field in place.owner.model_fields.items():
        if name == "kind" or members(field.annotation):
            continue
        doc = document(place, name)
        source = f" *{doc.source}.*" if doc.source else ""
        rows.append((f"`{name}`", f"`{doc.default}`", doc.kind, f"{_cell(doc.text)}{_cell(source)}"))
    return [markdown_table(("key", "default", "value", "description"), rows)] if rows else []


def _cell(text: str) -> str:
    line = " ".join(text.split())
    lead = " " if text.startswith(" ") else ""
    return lead + line.replace("<", "&lt;")


def commands_page() -> str:
    """Return the page with all `agrobot-mj` commands, their arguments and options."""
    lines = ["# Commands\n", "These are the texts of `agrobot-mj COMMAND --help`. Exit status: 0 for a run with the"]
    lines.append("expected outcome, 1 for another outcome or a full disk, 2 for bad input, 130 for an interrupt.\n")
    group: Any = typer.main.get_command(app)
    for name, command in group.commands.items():
        lines += [f"## `{name}`\n", f"{inspect.cleandoc(command.help or '')}\n", *_usage(name, command), ""]
    return "\n".join(lines)


def _usage(name: str, command: Any) -> list[str]:
    context = click.Context(command, info_name=f"agrobot-mj {name}")
    lines = ["```", f"agrobot-mj {name} {' '.join(command.collect_usage_pieces(context))}", "```", ""]
    rows = []
    for parameter in command.params:
        said = parameter.get_help_record(context)
        if said is None or "--help" in parameter.opts:
            continue
        flags, text = said
        rows.append((f"`{flags}`", _cell(text)))
    table = [markdown_table(("argument or option", "description"), rows), ""] if rows else []
    return [*lines, *table, "```sh", *(f"agrobot-mj {example}" for example in COMMANDS[name].examples), "```"]


def api_page() -> str:
    """Return the page of the Python interface: main functions and classes, and base classes."""
    lines = ["# Python\n", "```python", "from agrobot_mj import Simulation, load_scenario, register, run", "```\n"]
    lines += ["## Main functions and classes\n", *(_documented(name, name.rpartition(".")[2]) for name in FRONT)]
    lines.append("## Bases of the families\n")
    lines.append("These are the messages between the stages and the base classes of the families;")
    lines.append("[plugins](plugins.md) and [extending](extending.md) have examples.\n")
    return "\n".join([*lines, *(_documented(name, name) for name in BASES)])


def _documented(name: str, heading: str) -> str:
    """Return the mkdocstrings directive that inserts the documentation of a name."""
    return f'::: agrobot_mj.{name}\n    options:\n      heading: "{heading}"\n      toc_label: "{heading}"\n'
