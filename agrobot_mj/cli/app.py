"""Command-line application: commands, help texts, and global options.

Extensions and installed packages add commands through entry points of the group `agrobot_mj.commands`.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

import typer

from agrobot_mj.cli import authoring, recordings, runs, sweeps
from agrobot_mj.cli.answers import with_json
from agrobot_mj.cli.options import with_machine, with_plugins
from agrobot_mj.cli.panels import COMMANDS, HelpEntry, PanelledGroup, command_name, help_entry
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import entry_points_of
from agrobot_mj.core.version import __version__

Commands = Mapping[Callable[..., Any], HelpEntry | Sequence[str]]
"""Command functions, each with its help entry, or with only its examples for the panel `Other commands`."""
CORE: Commands = {
    runs.run: help_entry(
        "Run",
        "run circle",
        "run circle --set path.radius_m=6 --set plant.tyre.kind=soil --out runs/mine",
        "run side_slope_10 --machine row_crop --no-rrd --json",
    ),
    recordings.view: help_entry("Run", "view runs/mine/run.rrd", "view runs/mine/run.rrd --web"),
    recordings.snapshot: help_entry("Run", "snapshot runs/mine/run.rrd --at 5,60,120 --out pictures", advanced=True),
    runs.compare: help_entry(
        "Compare",
        "compare figure_eight --controllers pd,pd_t2fnn --seeds 3 --jobs 2",
        "compare side_slope_10 --guidance lqr,stanley --plants mujoco",
        'compare circle --variant "new:" --variant "worn: steering.valve.dead_band_v=0.8"',
    ),
    sweeps.sweep: help_entry(
        "Compare",
        "sweep validity --jobs 2",
        "sweep mine.toml --shard 1/4 --out part1",
        "sweep --merge part1 part2 --out whole",
    ),
    sweeps.report: help_entry(
        "Compare",
        "report runs/sweep-mine",
        "report runs/mine --share",
        "report runs/sweep-importance --metric lateral_rms",
        former={"importance": "report --metric xte_rms"},
    ),
    authoring.list_: help_entry("Write scenarios", "list", "list --machines", "list --kinds --json"),
    authoring.explain: help_entry("Write scenarios", "explain tractor.mass_kg", "explain terrain"),
    authoring.init: help_entry("Write scenarios", "init my_field"),
    authoring.schema: help_entry("Write scenarios", "schema > scenario.schema.json", advanced=True),
}
WIDEST = 74  # Maximum line length of an example [characters], for terminals with 80 columns


def epilog(examples: Sequence[str]) -> str:
    """Return the example commands as the end of a command's help text. Long lines are continued with a backslash."""
    if not examples:
        return ""
    lines = [line for example in examples for line in _wrap_at_options(f"agrobot-mj {example}")]
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)])


def _wrap_at_options(text: str) -> list[str]:
    """Split a command line at its options into lines of at most `WIDEST` characters."""
    if len(text) <= WIDEST or (at := text.rfind(" --", 0, WIDEST - 1)) < 0:
        return [text]
    return [f"{text[:at]} \\", *(f"    {line}" for line in _wrap_at_options(text[at + 1 :]))]


app = typer.Typer(
    name="agrobot-mj",
    cls=PanelledGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Simulate the guidance of a tractor: MuJoCo physics, controllers of the paper, Rerun recordings.",
    epilog="Exit status: 0 ended as expected, 1 ended otherwise, 2 invalid input, 130 interrupted.",
)


def _add(commands: Commands) -> None:
    for function, given in commands.items():
        if (name := command_name(function)) in COMMANDS:
            raise ScenarioError(f"a command {name} already exists")
        shown = given if isinstance(given, HelpEntry) else HelpEntry(given)
        command = function if function in ON_RECORDINGS else with_json(with_plugins(with_machine(function)))
        app.command(name, epilog=epilog(shown.examples))(command)
        COMMANDS[name] = shown


ON_RECORDINGS = (recordings.view, recordings.snapshot)
_add(CORE)
for entry in entry_points_of("commands"):
    try:
        _add(entry.load())
    except Exception as error:  # errors of installed packages do not affect other commands
        print(f"agrobot-mj: warning: commands of {entry.name} ({entry.value}) omitted: {error}", file=sys.stderr)


@app.callback(invoke_without_command=True)
def _before(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
    help_all: Annotated[bool, typer.Option("--help-all", help="List all commands, including advanced ones.")] = False,
) -> None:
    if version or help_all:
        print(__version__ if version else context.get_help())
        raise typer.Exit(0)
