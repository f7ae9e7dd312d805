"""The application: its commands in the order of the help, examples of each, and the options before any command."""

from collections.abc import Callable
from typing import Annotated, Any

import typer

from agrobot_mj.cli import authoring, fieldlogs, links, recordings, runs, studies, sweeps
from agrobot_mj.cli.answers import with_json
from agrobot_mj.cli.options import with_machine, with_plugins
from agrobot_mj.core.version import __version__

EXAMPLES = {
    "list": ("list", "list --machines", "list --kinds --json"),
    "explain": ("explain tractor.mass_kg", "explain terrain"),
    "init": ("init my_field",),
    "schema": ("schema > scenario.schema.json",),
    "machine": ("machine row_crop", "machine compact --json"),
    "run": (
        "run circle",
        "run circle --set path.radius_m=6 --set plant.tyre.kind=soil --out runs/mine",
        "run side_slope_10 --machine row_crop --no-rrd --json",
    ),
    "compare": (
        "compare figure_eight --controllers pd,pd_t2fnn --seeds 3 --jobs 2",
        "compare side_slope_10 --guidance lqr,stanley --plants mujoco",
        'compare circle --variant "new:" --variant "worn: steering.valve.dead_band_v=0.8"',
    ),
    "sweep": (
        "sweep validity --jobs 2",
        "sweep mine.toml --shard 1/4 --out part1",
        "sweep --merge part1 part2 --out whole",
    ),
    "limit": (
        'limit side_slope_10 --key terrain.grade_deg --range 0:25 --until "xte_rms > 0.3"',
        'limit circle --key path.radius_m --range 6:2 --until "xte_rms > 0.02" --guidance lqr,stanley --json',
    ),
    "importance": ("importance runs/sweep-importance", "importance runs/sweep-importance --metric lateral_rms"),
    "risk": ('risk side_slope_10_lqr --until "xte_abs_max > 0.4"',),
    "falsify": ('falsify lane_change --vary path.speed_m_s=1.2:3 --until "xte_abs_max > 0.3"',),
    "link": ("link figure_eight", "link figure_eight --address 192.168.1.20 --duration 600"),
    "ros2": ("ros2 figure_eight", "ros2 figure_eight --pace lock_step --stamped"),
    "export": ("export runs/mine --mcap", "export runs/mine --mcap --out bags"),
    "rig": ("rig soil", "rig magic_formula --out runs/tyre"),
    "validate": ("validate --quick", "validate --out runs/validation"),
    "tune": ("tune figure_eight --guidance lqr", "tune my_field.toml --guidance stanley --budget 64 --seeds 2"),
    "report": ("report runs/sweep-mine",),
    "identify": ("identify runs/mine", "identify field.csv --map map.toml --vehicle --machine row_crop"),
    "replay": ("replay field.csv --map map.toml --describe", "replay field.csv --map map.toml --machine row_crop"),
    "calibrate": ("calibrate field.csv --map map.toml --set tractor.wheelbase_m=2.1 --out calibration",),
    "twin": ("twin field.csv --map map.toml --machine row_crop --out mine",),
    "view": ("view runs/mine/run.rrd", "view runs/mine/run.rrd --web"),
    "snapshot": ("snapshot runs/mine/run.rrd --at 5,60,120 --out pictures",),
}
"""Command lines without the name of the program, by command."""
WIDEST = 74
"""Columns of an example, so that help fits a terminal of 80."""


def epilog(command: str) -> str:
    """The examples at the end of a command's help; a line too long goes on in the next one, as in a shell."""
    lines = [line for example in EXAMPLES[command] for line in _folded(f"agrobot-mj {example}")]
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)])


def _folded(text: str) -> list[str]:
    """A command line in lines of `WIDEST` columns, folded before options."""
    if len(text) <= WIDEST or (at := text.rfind(" --", 0, WIDEST - 1)) < 0:
        return [text]
    return [f"{text[:at]} \\", *(f"    {line}" for line in _folded(text[at + 1 :]))]


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
    *(runs.run, runs.compare, sweeps.sweep, sweeps.limit, sweeps.importance, sweeps.risk, sweeps.falsify),
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
