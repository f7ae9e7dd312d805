"""The application: its commands in the order of the help, and the options before any command."""

from collections.abc import Callable
from typing import Annotated, Any

import typer

from agrobot_mj.cli import authoring, failures, fieldlogs, links, recordings, runs, studies, sweeps
from agrobot_mj.cli.answers import with_json
from agrobot_mj.cli.examples import epilog
from agrobot_mj.cli.options import with_machine, with_plugins
from agrobot_mj.core.version import __version__

app = typer.Typer(
    name="agrobot-mj",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Does a guidance stack survive a real tractor? MuJoCo physics, the paper's controllers, Rerun recordings.",
    epilog="Exit status: 0 ended as expected, 1 ended otherwise, 2 bad input, 130 interrupted.",
)
ON_SCENARIOS: tuple[Callable[..., Any], ...] = (
    *(authoring.list_, authoring.explain, authoring.init, authoring.schema, authoring.machine),
    *(runs.run, runs.compare, sweeps.sweep, sweeps.limit, sweeps.importance, failures.risk, failures.falsify),
    *(links.link, links.ros2, links.export, studies.rig, studies.validate, studies.tune, sweeps.report),
    *(fieldlogs.identify, fieldlogs.replay, fieldlogs.calibrate, fieldlogs.twin),
)
ON_RECORDINGS: tuple[Callable[..., None], ...] = (recordings.view, recordings.snapshot)
for command in (*map(with_json, map(with_plugins, map(with_machine, ON_SCENARIOS))), *ON_RECORDINGS):
    name = command.__name__.rstrip("_")
    app.command(name, epilog=epilog(name))(command)


@app.callback(invoke_without_command=True)
def _version(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    if version:
        print(__version__)
        raise typer.Exit(0)
