"""Commands on logs, of runs and of real machines: `replay` and `identify`."""

import sys
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from agrobot_mj.cli.options import Out, Quiet, Sets, finite, names, number, overrides, results_folder
from agrobot_mj.cli.output import say

if TYPE_CHECKING:
    from agrobot_mj.fieldlogs.columns import Source
    from agrobot_mj.fieldlogs.maps import LogMap
    from agrobot_mj.scenario.schema import Scenario

MapFile = Annotated[
    Path | None,
    typer.Option("--map", metavar="MAP.toml", help="Meaning of the columns; see docs/replay.md. Our own need none."),
]
Base = Annotated[
    str | None,
    typer.Option("--scenario", metavar="SCENARIO", help="Tractor, plant, tyres, terrain; that beside the log if any."),
]
From = Annotated[
    float, typer.Option("--from", min=0, metavar="S", callback=finite, help="First time of the log that counts [s].")
]
To = Annotated[float, typer.Option("--to", metavar="S", callback=number, help="Last time of the log that counts [s].")]


def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A recording, or a run's folder; see docs/replay.md.")],
    map_file: MapFile = None,
    base: Base = None,
    sets: Sets = None,
    by: Annotated[
        Literal["steer", "valve"] | None, typer.Option("--by", help="What steers; the wheel angle if it is there.")
    ] = None,
    start: From = 0.0,
    end: To = inf,
    told: Annotated[
        bool, typer.Option("--describe", help="Say what the log holds and what it can be used for; drive nothing.")
    ] = False,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Drive a plant by the steering and speed of a recording.

    Tells how far its yaw rate and position are from the recorded ones; writes replay.json, .parquet and .png.
    """
    from agrobot_mj.fieldlogs.replay import files_of_replay, summary, write_replay
    from agrobot_mj.fieldlogs.replay import replay as drive
    from agrobot_mj.simulation.storage import exclusive

    if told:
        from agrobot_mj.fieldlogs.maps import read_map
        from agrobot_mj.fieldlogs.readers import open_log
        from agrobot_mj.fieldlogs.readers.describe import describe

        say(describe(open_log(log), read_map(map_file) if map_file else None))
        return
    scenario = _scenario(log, base, sets)
    source, log_map = _source(log, map_file)
    folder = results_folder(out, f"replay-{log.stem}")
    with exclusive(folder, files_of_replay(scenario)):
        found = drive(source, log_map, scenario, by, start, end)
        write_replay(found, scenario, folder)
    if not quiet:
        say(summary(found))
        say(folder)
    if found.driven.outcome != "completed":
        print(f"{log.name}: the plant stops at {found.driven.t[-1]:.2f} s: {found.driven.outcome}", file=sys.stderr)
        raise typer.Exit(1)


def identify(
    log: Annotated[Path, typer.Argument(metavar="RUN_DIR|LOG", help="A run's folder; with --vehicle any log.")],
    vehicle: Annotated[bool, typer.Option("--vehicle", help="Fit the vehicle instead of the valve.")] = False,
    map_file: MapFile = None,
    base: Base = None,
    sets: Sets = None,
    fitted: Annotated[
        str, typer.Option("--fit", help="With --vehicle: what to fit; lag, too, where the steering is quick.")
    ] = "front,rear,relaxation,offset,delay,backlash",
    share: Annotated[
        float,
        typer.Option(
            min=0.2, max=0.9, callback=finite, help="With --vehicle: share of the log to fit; the rest judges."
        ),
    ] = 0.6,
    start: From = 0.0,
    end: To = inf,
    out: Out = None,
) -> None:
    """Fit the steering valve to a run, or a vehicle to a log.

    Prints dead band, gains, rate limit, lag and delay with their uncertainty. With --vehicle: cornering stiffness,
    understeer gradient, relaxation lengths, steering offset, delay and backlash with 95 % intervals.
    """
    if not vehicle:
        from agrobot_mj.fieldlogs.identify.valve import identify_command
        from agrobot_mj.simulation.ownership import check_output

        check_output(log, ("identified.json",))
        say(identify_command(log))
        return
    from agrobot_mj.fieldlogs.identify import identify_vehicle_command
    from agrobot_mj.fieldlogs.identify.vehicle import NothingExplainedError

    scenario = _scenario(log, base, sets)
    source, log_map = _source(log, map_file)
    folder = (log if log.is_dir() else None) if out is None else results_folder(out, "")
    options = {"names": names(fitted, "--fit"), "share": share, "start_s": start, "end_s": end}
    try:
        say(identify_vehicle_command(source, log_map, scenario, folder, **options))
    except NothingExplainedError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(1) from None


def _scenario(log: Path, base: str | None, sets: list[str] | None) -> "Scenario":
    """The scenario named, or that beside the log, or the defaults on level ground; with overrides."""
    from agrobot_mj.scenario.loading import load_scenario

    beside = (log if log.is_dir() else log.parent) / "scenario.toml"
    if base is None and beside.is_file() and (log.is_dir() or log.name in ("signals.parquet", "link.parquet")):
        return load_scenario(beside, overrides(sets))
    return load_scenario(base or "straight_line", overrides(sets))


def _source(log: Path, map_file: Path | None) -> "tuple[Source, LogMap | None]":
    """The log as its reader returns it, and its map."""
    from agrobot_mj.fieldlogs.maps import read_map
    from agrobot_mj.fieldlogs.readers import open_log

    log_map = read_map(map_file) if map_file is not None else None
    found = open_log(log)
    return found.source, log_map or found.checked_map()
