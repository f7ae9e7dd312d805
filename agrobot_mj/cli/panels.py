"""Help text of the command line, with commands grouped in panels. Only `--help-all` lists advanced commands."""

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NamedTuple

import typer
from typer.core import TyperGroup

PANELS = ("Run", "Field work", "Compare", "Field logs", "Check", "Connect", "Write scenarios")
"""Titles of the panels in the order of the help text. Panels of installed packages come after these panels."""


class HelpEntry(NamedTuple):
    """Entry of a command in the help text of the command line."""

    examples: Sequence[str] = ()  # Example command lines without the program name
    panel: str = "Other commands"
    advanced: bool = False  # Whether only `--help-all` lists the command
    former: Mapping[str, str] = MappingProxyType({})
    """Words of this command, keyed by a deprecated command with the same effect, in the form `NAME` or `NAME --flag`.
    Deprecated commands will be removed in the next version."""


def help_entry(
    panel: str, *examples: str, advanced: bool = False, former: Mapping[str, str] = MappingProxyType({})
) -> HelpEntry:
    """Return the help entry of a command with its panel and its example command lines."""
    return HelpEntry(examples, panel, advanced, former)


COMMANDS: dict[str, HelpEntry] = {}


def command_name(function: Callable[..., Any]) -> str:
    """Return the command name of a function: without trailing underscores, and with spaces for other underscores."""
    return function.__name__.rstrip("_").replace("_", " ")


def split_command(words: Sequence[str]) -> tuple[str, list[str]]:
    """Split a command line into the command name, of one or two words, and the remaining words."""
    count = 2 if " ".join(words[:2]) in COMMANDS else 1
    return " ".join(words[:count]), list(words[count:])


def _present_command(args: list[str]) -> list[str]:
    """Return a command line in which a deprecated command is replaced by the present one, and print a notice."""
    for former, now in (pair for entry in COMMANDS.values() for pair in entry.former.items()):
        name, *flags = former.split()
        if args[0] == name and all(flag in args for flag in flags):
            said = f"{former}: use `agrobot-mj {now}`; this command will be removed in the next version"
            print(said, file=sys.stderr)
            return [*now.split(), *(word for word in args[1:] if word not in flags)]
    return args


class PanelledGroup(TyperGroup):
    """Command group that lists its commands in panels and supports command names of two words."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command name, the command, and its arguments from the words `args` of a command line."""
        for before, word in pairwise(("", *args)):
            if re.fullmatch(r"(--[\w-]+=)?\s*", word):
                place = f" after {before}" if before else ""
                what = word.strip() or "an argument"
                ctx.fail(f"{what} is blank{place}; check the quotes and the shell variables of the command line")
        name, rest = split_command(_present_command(args))
        if parts := [each for each in COMMANDS if each.startswith(f"{name} ")]:
            if "--help" in rest:
                formatter = ctx.make_formatter()
                formatter.write_dl(self._rows(parts, parts, formatter))
                typer.echo(formatter.getvalue(), nl=False)
                ctx.exit()
            ctx.fail(f"{name}: specify one of its commands: {', '.join(parts)}")
        return super().resolve_command(ctx, [name, *rest])

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the panels of the help text. With `--help-all` advanced commands are included."""
        whole = ctx.params.get("help_all", False)
        shown = {name: each for name, each in COMMANDS.items() if whole or not each.advanced}
        for panel in dict.fromkeys((*PANELS, *(each.panel for each in shown.values()))):
            if names := [name for name in shown if shown[name].panel == panel]:
                with formatter.section(panel):
                    formatter.write_dl(self._rows(names, [*shown], formatter))

    def _rows(self, names: Sequence[str], aligned: Sequence[str], formatter: Any) -> list[tuple[str, str]]:
        """Return name and description of each command in `names`. Names are padded to the longest name in `aligned`."""
        width = max(map(len, aligned))
        limit = formatter.width - width - 6
        return [(f"{name:{width}}", self.commands[name].get_short_help_str(limit)) for name in names]
