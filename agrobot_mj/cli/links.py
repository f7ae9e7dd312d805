"""Commands that let a program outside drive: `link`."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from agrobot_mj.cli.interrupts import stop_on_signals
from agrobot_mj.cli.options import NoRrd, Out, Plugins, Quiet, Sets, Source, load_plugins, overrides, results_folder
from agrobot_mj.cli.output import say

if TYPE_CHECKING:
    from agrobot_mj.recording import Recording


def link(
    source: Source,
    sets: Sets = None,
    plugins: Plugins = None,
    address: Annotated[str, typer.Option(help="Address of the guidance program.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port of the tractor's boards.")] = 8888,
    host_port: Annotated[int, typer.Option(help="Port of the guidance program.")] = 9999,
    steer_by: Annotated[Literal["angle", "pwm"] | None, typer.Option(help="guidance.steer_by")] = None,
    host: Annotated[Literal["agopengps", "agopenweb"] | None, typer.Option(help="guidance.host")] = None,
    duration: Annotated[float | None, typer.Option(help="duration_s [s]")] = None,
    start: Annotated[Literal["heard", "engaged", "now"], typer.Option(help="What starts the run's clock.")] = "heard",
    wait: Annotated[float, typer.Option(min=0, help="Longest wait for that [s].")] = 60.0,
    pace: Annotated[Literal["real_time", "answered"], typer.Option(help="What paces the run.")] = "real_time",
    nmea: Annotated[str | None, typer.Option(metavar="ADDRESS:PORT", help="Send GGA, RMC and VTG there, too.")] = None,
    replay: Annotated[Path | None, typer.Option(metavar="LINK.parquet", help="Drive from an earlier run.")] = None,
    out: Out = None,
    no_rrd: NoRrd = False,
    live: Annotated[bool, typer.Option("--live", help="Show the run in a Rerun viewer as it goes.")] = False,
    quiet: Quiet = False,
) -> None:
    """Let a guidance program of the AgOpenGPS family drive over UDP.

    The tractor is its steer module, GNSS receiver and inertial unit. Writes link.parquet beside the files of a run.
    """
    from agrobot_mj.links.agopengps.command import Arguments
    from agrobot_mj.links.agopengps.command import link as run_link
    from agrobot_mj.links.agopengps.session import NoHostError
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.simulation.storage import claimed

    load_plugins(plugins)
    given = {"guidance.kind": "agopengps", "guidance.steer_by": steer_by, "guidance.host": host, "duration_s": duration}
    scenario = load_scenario(source, {k: v for k, v in given.items() if v is not None} | overrides(sets))
    folder = results_folder(out, f"{scenario.name}-link-{scenario.hash8}")
    arguments = Arguments(address, port, host_port, replay, start, wait, nmea, pace, live, not no_rrd)
    tell = (lambda text: None) if quiet else partial(typer.echo, err=True)
    try:
        with claimed(folder), stop_on_signals() as stopped:
            watchers = _recordings(folder, no_rrd, live)
            log = run_link(scenario, folder, arguments, watchers, lambda: bool(stopped), tell)
    except NoHostError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(1) from None
    if not quiet:
        say(f"{scenario.name}: {log.outcome}, engaged {log.metrics['link']['engaged_s']:.1f} s, {folder}")
    if log.outcome != scenario.expected_outcome:
        print(f"{scenario.name}: ended after {log.column('t')[-1]:.2f} s: {log.outcome}", file=sys.stderr)
        raise typer.Exit(1)


def _recordings(folder: Path, no_rrd: bool, live: bool) -> "tuple[Recording, ...]":
    """The recording that follows the run, if any."""
    if no_rrd and not live:
        return ()
    from agrobot_mj.recording import Recording

    return (Recording(None if no_rrd else folder / "run.rrd", live=live),)
