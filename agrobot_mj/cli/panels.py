"""The list of commands in the help: in panels, of which a newcomer sees the commands of the first days."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from typer.core import TyperGroup

PANELS = ("Run", "Compare", "Field logs", "Check", "Connect", "Write scenarios")
"""Panels in the order of the help; those of installed packages follow."""


class HelpEntry(NamedTuple):
    """How the help shows a command."""

    examples: Sequence[str] = ()
    """Command lines without the name of the program."""
    panel: str = "Other commands"
    advanced: bool = False
    """Whether only `--help-all` lists it."""
    now: str = ""
    """What has replaced a command that stays for one version, and that no help lists."""


def listed(panel: str, *examples: str, advanced: bool = False) -> HelpEntry:
    """A command in a panel."""
    return HelpEntry(examples, panel, advanced)


COMMANDS: dict[str, HelpEntry] = {}
"""Every command by its name."""


class PanelledGroup(TyperGroup):
    """The program, whose help lists its commands in panels."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the panels, with the advanced commands after `--help-all`."""
        whole = ctx.params.get("help_all", False)
        shown = {name: each for name, each in COMMANDS.items() if not each.now and (whole or not each.advanced)}
        width = max(map(len, shown))
        for panel in dict.fromkeys((*PANELS, *(each.panel for each in shown.values()))):
            names = [name for name, each in shown.items() if each.panel == panel]
            rows = [
                (f"{name:{width}}", self.commands[name].get_short_help_str(formatter.width - width - 6))
                for name in names
            ]
            if rows:
                with formatter.section(panel):
                    formatter.write_dl(rows)
