"""Commands of the links: `link` and `ros2` run an external control program, `export` converts a run to other
formats."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from agrobot_mj.cli.interrupts import stop_on_signals
from agrobot_mj.cli.options import Answer, NoRrd, Out, Quiet, Sets, Source, finite, number, overrides, results_folder
from agrobot_mj.cli.output import print_hints, say
from agrobot_mj.cli.panels import help_entry
from agrobot_mj.cli.runs import Live, answer, recordings
from agrobot_mj.core.errors import ScenarioError

if TYPE_CHECKING:
    from agrobot_mj.extensions.links.agopengps.session import LinkOptions
    from agrobot_mj.extensions.links.ros2.session import RosOptions
    from agrobot_mj.scenario.schema import Scenario
    from agrobot_mj.simulation.log import Log


Duration = Annotated[float | None, typer.Option(callback=finite, help="duration_s [s]")]


def link(
    source: Source,
    sets: Sets = None,
    address: Annotated[str, typer.Option(help="Address of the guidance program.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the tractor's boards.")] = 8888,
    host_port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the guidance program.")] = 9999,
    steer_by: Annotated[Literal["angle", "pwm"] | None, typer.Option(help="guidance.steer_by")] = None,
    host: Annotated[Literal["agopengps", "agopenweb"] | None, typer.Option(help="guidance.host")] = None,
    duration: Duration = None,
    start: Annotated[
        Literal["heard", "engaged", "now"], typer.Option(help="Event that starts the clock of the run.")
    ] = "heard",
    wait: Annotated[
        float, typer.Option(min=0, callback=number, help="Maximum wait for the event of --start [s], or inf.")
    ] = 60.0,
    pace: Annotated[
        str, typer.Option(help="real_time, answered (by the host), or simulated seconds per second, such as 0.5.")
    ] = "real_time",
    nmea: Annotated[
        str | None, typer.Option(metavar="ADDRESS:PORT", help="Also send GGA, RMC and VTG to this address.")
    ] = None,
    replay: Annotated[
        Path | None, typer.Option(metavar="LINK.parquet", help="Recorded messages of an earlier run, to replay.")
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Check the connection for 20 s; list settings, and write no files.")
    ] = False,
    out: Out = None,
    no_rrd: NoRrd = False,
    live: Live = False,
    quiet: Quiet = False,
) -> Answer:
    """Run with a program of the AgOpenGPS family over UDP.

    The tractor acts as steer module, GNSS receiver and inertial unit. Writes link.parquet and the files of a run.
    """
    from agrobot_mj.extensions.links.agopengps.link import endpoint, pace_of
    from agrobot_mj.extensions.links.agopengps.link import link as run_link
    from agrobot_mj.extensions.links.agopengps.session import LinkOptions

    if port == host_port:
        raise ScenarioError(f"--port {port}: the guidance program uses this port (--host-port); specify another port")
    options = LinkOptions(
        *(address, port, host_port, replay, start, wait, endpoint(nmea, "--nmea") if nmea else None, pace_of(pace)),
        *(live, not no_rrd, _tell(quiet)),
    )
    keys = {"guidance.kind": "agopengps", "guidance.steer_by": steer_by, "guidance.host": host, "duration_s": duration}
    given = (source, keys, sets)
    if check:
        return _check(options, given, quiet)
    return _drive(run_link, options, given, out, quiet, lambda found: f"engaged {found['link']['engaged_s']:.1f} s")


def ros2(
    source: Source,
    sets: Sets = None,
    pace: Annotated[Literal["real_time", "lock_step"], typer.Option(help="Time base of the run.")] = "real_time",
    every: Annotated[int, typer.Option(min=1, help="Ticks per /cmd_vel message in lock-step mode.")] = 1,
    start: Annotated[Literal["heard", "now"], typer.Option(help="Event that starts the clock of the run.")] = "heard",
    wait: Annotated[float, typer.Option(min=0, callback=number, help="Maximum wait for /cmd_vel [s], or inf.")] = 60.0,
    duration: Duration = None,
    stamped: Annotated[bool, typer.Option("--stamped", help="Use TwistStamped messages on /cmd_vel.")] = False,
    domain: Annotated[int | None, typer.Option(help="ROS_DOMAIN_ID")] = None,
    namespace: Annotated[str, typer.Option(metavar="NAME", help="Namespace of the node and its topics.")] = "",
    network: Annotated[bool, typer.Option("--network", help="Make the topics available to other computers.")] = False,
    out: Out = None,
    no_rrd: NoRrd = False,
    live: Live = False,
    quiet: Quiet = False,
) -> Answer:
    """Run with a ROS 2 program that sends commands on /cmd_vel.

    The tractor is a node that publishes sensor data, odometry, path and clock. Requires the extra ros, in a separate
    environment.
    """
    from agrobot_mj.extensions.links.ros2.session import SENSORS, RosOptions
    from agrobot_mj.extensions.links.ros2.session import ros2 as run_node

    options = RosOptions(
        pace, every, start, wait, network, domain, stamped, namespace, live, recorded=not no_rrd, notify=_tell(quiet)
    )
    keys = {"guidance.kind": "cmd_vel", **SENSORS, "duration_s": duration}
    given = (source, keys, sets)
    return _drive(run_node, options, given, out, quiet, lambda found: f"{found['ros2']['requests']} requests")


def export(
    folder: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="Folder of a run.")],
    mcap: Annotated[bool, typer.Option("--mcap", help="Write ROS 2 messages in an MCAP file.")] = False,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Convert a run for other programs.

    Foxglove and `ros2 bag` open MCAP files. Writing MCAP files requires the extra mcap, but not ROS.
    """
    if not mcap:
        raise ScenarioError("export: no format is specified; add --mcap")
    from agrobot_mj.extensions.links.ros2.bag import FILE, export_run

    if out is not None and out.suffix == ".mcap":
        raise ScenarioError(f"--out {out}: specify a folder; {FILE} is written into it")
    file, count = export_run(folder, folder if out is None else results_folder(out, ""))
    if not quiet:
        say(f"{file}: {count} messages")


def _tell(quiet: bool) -> Callable[[str], None]:
    return (lambda text: None) if quiet else partial(typer.echo, err=True)


def _check(options: "LinkOptions", given: tuple[str, dict[str, Any], list[str] | None], quiet: bool) -> Answer:
    """Check the connection and return the `Answer` of the command."""
    from agrobot_mj.extensions.links.agopengps.link import check
    from agrobot_mj.extensions.links.running import NotBegunError

    scenario = _load_given(given)
    print_hints([scenario], quiet)
    with stop_on_signals() as stopped:
        try:
            block, lines = check(scenario, options, stopped)
        except NotBegunError as error:
            return Answer({"scenario": scenario.name}, "", str(error))
    return Answer({"scenario": scenario.name, "link": block, "check": lines}, "\n".join(lines))


def _load_given(given: tuple[str, dict[str, Any], list[str] | None]) -> "Scenario":
    """Return the scenario defined by `given`: source, keys and overrides."""
    from agrobot_mj.scenario.loading import load_scenario

    source, keys, sets = given
    return load_scenario(source, {k: v for k, v in keys.items() if v is not None} | overrides(sets))


def _drive(
    drive: Callable[..., "Log"],
    options: "LinkOptions | RosOptions",
    given: tuple[str, dict[str, Any], list[str] | None],
    out: Path | None,
    quiet: bool,
    about: Callable[[dict[str, Any]], str],
) -> Answer:
    """Run a scenario with an external program and return the result. `given` contains source, keys and overrides."""
    from agrobot_mj.extensions.links.running import NotBegunError
    from agrobot_mj.simulation.results import remove, results
    from agrobot_mj.simulation.storage import RECORDING, files_of_run

    scenario = _load_given(given)
    said = print_hints([scenario], quiet)
    folder = results_folder(out, f"{scenario.name}-{scenario.guidance.outside}-{scenario.hash8}")
    watchers = recordings(folder, options.recorded, options.live)
    with results(folder, files_of_run(scenario)), stop_on_signals() as stopped:
        try:
            log = drive(scenario, folder, options, watchers, stopped)
        except NotBegunError as error:
            remove(folder, [RECORDING])
            return Answer({"scenario": scenario.name}, "", str(error))
    return answer(log, folder, said, [about(log.metrics)])


COMMANDS = {
    link: help_entry("Connect", "link figure_eight", "link figure_eight --address 192.168.1.20 --duration 600"),
    ros2: help_entry("Connect", "ros2 figure_eight", "ros2 figure_eight --pace lock_step --stamped", advanced=True),
    export: help_entry("Connect", "export runs/mine --mcap", "export runs/mine --mcap --out bags", advanced=True),
}
