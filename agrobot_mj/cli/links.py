"""Commands that connect programs outside: `link` and `ros2` let one drive, `export` writes a run for others."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from agrobot_mj.cli.hints import tell_doubts
from agrobot_mj.cli.interrupts import stop_on_signals
from agrobot_mj.cli.options import (
    NoRrd,
    Out,
    Plugins,
    Quiet,
    Sets,
    Source,
    finite,
    load_plugins,
    number,
    overrides,
    results_file,
    results_folder,
)
from agrobot_mj.cli.output import say

if TYPE_CHECKING:
    from agrobot_mj.recording import Recording
    from agrobot_mj.simulation.log import Log


def link(
    source: Source,
    sets: Sets = None,
    plugins: Plugins = None,
    address: Annotated[str, typer.Option(help="Address of the guidance program.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port of the tractor's boards.")] = 8888,
    host_port: Annotated[int, typer.Option(help="Port of the guidance program.")] = 9999,
    steer_by: Annotated[Literal["angle", "pwm"] | None, typer.Option(help="guidance.steer_by")] = None,
    host: Annotated[Literal["agopengps", "agopenweb"] | None, typer.Option(help="guidance.host")] = None,
    duration: Annotated[float | None, typer.Option(callback=finite, help="duration_s [s]")] = None,
    start: Annotated[Literal["heard", "engaged", "now"], typer.Option(help="What starts the run's clock.")] = "heard",
    wait: Annotated[float, typer.Option(min=0, callback=number, help="Longest wait for that [s].")] = 60.0,
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
    from agrobot_mj.links.running import NotBegunError
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.simulation.storage import exclusive, files_of_run

    load_plugins(plugins)
    given = {"guidance.kind": "agopengps", "guidance.steer_by": steer_by, "guidance.host": host, "duration_s": duration}
    scenario = load_scenario(source, {k: v for k, v in given.items() if v is not None} | overrides(sets))
    tell_doubts([scenario], quiet)
    folder = results_folder(out, f"{scenario.name}-link-{scenario.hash8}")
    arguments = Arguments(address, port, host_port, replay, start, wait, nmea, pace, live, not no_rrd)
    tell = (lambda text: None) if quiet else partial(typer.echo, err=True)
    try:
        with exclusive(folder, files_of_run(scenario)), _begun(folder), stop_on_signals() as stopped:
            watchers = _recordings(folder, no_rrd, live)
            log = run_link(scenario, folder, arguments, watchers, lambda: bool(stopped), tell)
    except NotBegunError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(1) from None
    if not quiet:
        say(f"{scenario.name}: {log.outcome}, engaged {log.metrics['link']['engaged_s']:.1f} s, {folder}")
    if not log.as_expected:
        print(f"{scenario.name}: ended after {log.column('t')[-1]:.2f} s: {log.outcome}", file=sys.stderr)
        raise typer.Exit(1)


def ros2(
    source: Source,
    sets: Sets = None,
    plugins: Plugins = None,
    pace: Annotated[Literal["real_time", "lock_step"], typer.Option(help="What paces the run.")] = "real_time",
    every: Annotated[int, typer.Option(min=1, help="Ticks for each /cmd_vel in lock-step.")] = 1,
    start: Annotated[Literal["heard", "now"], typer.Option(help="What starts the run's clock.")] = "heard",
    wait: Annotated[float, typer.Option(min=0, callback=number, help="Longest wait for /cmd_vel [s].")] = 60.0,
    duration: Annotated[float | None, typer.Option(callback=finite, help="duration_s [s]")] = None,
    stamped: Annotated[bool, typer.Option("--stamped", help="/cmd_vel is a TwistStamped.")] = False,
    domain: Annotated[int | None, typer.Option(help="ROS_DOMAIN_ID")] = None,
    network: Annotated[bool, typer.Option("--network", help="Let other computers see the topics.")] = False,
    out: Out = None,
    no_rrd: NoRrd = False,
    live: Annotated[bool, typer.Option("--live", help="Show the run in a Rerun viewer as it goes.")] = False,
    quiet: Quiet = False,
) -> None:
    """Let a ROS 2 program drive over /cmd_vel.

    The tractor is a node with sensors, odometry, path and clock. Needs the extra ros, in an environment of its own.
    """
    from agrobot_mj.links.ros2.command import SENSORS, RosArguments
    from agrobot_mj.links.ros2.command import ros2 as run_node
    from agrobot_mj.links.ros2.session import RosOptions
    from agrobot_mj.links.running import NotBegunError
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.simulation.ownership import remove
    from agrobot_mj.simulation.storage import exclusive, files_of_run

    load_plugins(plugins)
    length = {} if duration is None else {"duration_s": duration}
    scenario = load_scenario(source, {"guidance.kind": "cmd_vel", **SENSORS, **length} | overrides(sets))
    tell_doubts([scenario], quiet)
    folder = results_folder(out, f"{scenario.name}-ros2-{scenario.hash8}")
    tell = (lambda text: None) if quiet else partial(typer.echo, err=True)
    arguments = RosArguments(RosOptions(pace, every, start, wait, tell), network, domain, stamped, live)
    try:
        with exclusive(folder, files_of_run(scenario)), _begun(folder), stop_on_signals() as stopped:
            watchers = _recordings(folder, no_rrd, live)
            log = run_node(scenario, folder, arguments, watchers, lambda: bool(stopped))
    except NotBegunError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(1) from None
    if no_rrd:
        remove(folder, ["run.rrd"])  # of an earlier run, beside these signals it would mislead
    if not quiet:
        say(f"{scenario.name}: {log.outcome}, {log.metrics['ros2']['requests']} requests, {folder}")
    if not log.as_expected:
        print(f"{scenario.name}: ended after {_end(log):.2f} s: {log.outcome}", file=sys.stderr)
        raise typer.Exit(1)


def export(
    folder: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="A folder that a run has written.")],
    mcap: Annotated[bool, typer.Option("--mcap", help="As ROS 2 messages in an MCAP file.")] = False,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="The file; run.mcap in the folder.")] = None,
    plugins: Plugins = None,
    quiet: Quiet = False,
) -> None:
    """Write a run for other programs.

    MCAP is what Foxglove and `ros2 bag` open; needs the extra mcap and no ROS.
    """
    from agrobot_mj.core.errors import ScenarioError

    if not mcap:
        raise ScenarioError("export: name a format: --mcap")
    load_plugins(plugins)
    from agrobot_mj.links.ros2.bag import export_run

    file, count = export_run(folder, None if out is None else results_file(out))
    if not quiet:
        print(f"{file}: {count} messages")


def _end(log: "Log") -> float:
    """Time of the last tick, 0 before the first [s]."""
    t = log.column("t")
    return float(t[-1]) if len(t) else 0.0


@contextmanager
def _begun(folder: Path) -> Iterator[None]:
    """Take the recording away again where no program came: there was no run."""
    from agrobot_mj.links.running import NotBegunError
    from agrobot_mj.simulation.ownership import remove
    from agrobot_mj.simulation.storage import RECORDING

    try:
        yield
    except NotBegunError:
        remove(folder, [RECORDING])
        raise


def _recordings(folder: Path, no_rrd: bool, live: bool) -> "tuple[Recording, ...]":
    """The recording that follows the run, if any."""
    if no_rrd and not live:
        return ()
    from agrobot_mj.recording import Recording

    return (Recording(None if no_rrd else folder / "run.rrd", live=live),)
