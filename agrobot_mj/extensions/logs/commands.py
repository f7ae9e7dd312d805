"""Commands on logs, of runs and of real machines: `replay`, `calibrate`, `identify` and `twin`."""

import sys
from contextlib import nullcontext
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from agrobot_mj.cli.options import Out, Quiet, Sets, finite, names, number, overrides, results_folder
from agrobot_mj.cli.output import say
from agrobot_mj.core.errors import ScenarioError

if TYPE_CHECKING:
    from agrobot_mj.core.table_columns import Source
    from agrobot_mj.extensions.logs.maps import LogMap
    from agrobot_mj.scenario.schema import Scenario

MapFile = Annotated[
    Path | None,
    typer.Option("--map", metavar="MAP.toml", help="Meaning of the columns; see docs/replay.md. Our own need none."),
]
Base = Annotated[
    str | None,
    typer.Option("--scenario", metavar="SCENARIO", help="Tractor, plant, tyres, terrain; that beside the log if any."),
]
Logs = Annotated[
    list[Path], typer.Argument(metavar="LOG", help="Recordings of one machine (docs/replay.md), or a run's folder.")
]
From = Annotated[
    float, typer.Option("--from", min=0, metavar="S", callback=finite, help="First time of the log that counts [s].")
]
To = Annotated[float, typer.Option("--to", metavar="S", callback=number, help="Last time of the log that counts [s].")]


def replay(
    logs: Logs,
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
    from agrobot_mj.extensions.logs.replay import files_of_replay, summary, write_replay
    from agrobot_mj.extensions.logs.replay import replay as drive
    from agrobot_mj.simulation.results import results

    if told:
        from agrobot_mj.extensions.logs.maps import read_map
        from agrobot_mj.extensions.logs.readers import open_log
        from agrobot_mj.extensions.logs.readers.describe import describe

        own = read_map(map_file) if map_file else None
        say("\n\n".join(describe(open_log(log), own) for log in logs))
        return
    scenario = _scenario(logs, base, sets)
    sources, log_map = _sources(logs, map_file)
    folder = results_folder(out, f"replay-{logs[0].stem}")
    with results(folder, files_of_replay(scenario)):
        found = drive(sources, log_map, scenario, by, start, end)
        write_replay(found, scenario, folder)
    if not quiet:
        say(summary(found, scenario.tractor))
        say(folder)
    stopped = [(recording.name, driven) for recording, driven in found.pieces if driven.outcome != "completed"]
    for name, driven in stopped:
        print(f"{name}: the plant stops at {driven.t[-1]:.2f} s: {driven.outcome}", file=sys.stderr)
    if stopped:
        raise typer.Exit(1)


def calibrate(
    logs: Logs,
    map_file: MapFile = None,
    base: Base = None,
    sets: Sets = None,
    start: From = 0.0,
    end: To = inf,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Find centre and scale of the steering sensor, ages, antenna.

    Prints what they mean in plain words and the map with them, with 95 % intervals; the wheelbase must be known
    (--machine, or --set tractor.wheelbase_m=2.1). --out writes map.toml and calibration.json.
    """
    from agrobot_mj.extensions.logs.calibrate import FILES, report, write_calibration
    from agrobot_mj.extensions.logs.calibrate import calibrate as find
    from agrobot_mj.simulation.results import results

    folder = None if out is None else results_folder(out, "")
    scenario = _scenario(logs, base, sets)
    sources, log_map = _sources(logs, map_file)
    with results(folder, FILES) if folder else nullcontext():
        found = find(sources, log_map, scenario, start, end)
        if folder:
            write_calibration(found, folder)
    if not quiet:
        say(report(found, scenario.tractor))


def twin(
    logs: Logs,
    map_file: MapFile = None,
    base: Base = None,
    sets: Sets = None,
    share: Annotated[
        float, typer.Option(min=0.2, max=0.9, callback=finite, help="Share of the logs to fit; the rest judges.")
    ] = 0.6,
    start: From = 0.0,
    end: To = inf,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Write the machine that drove, and how far to believe it.

    Sizes and masses are those of --machine and --set. Writes report.html, machine.toml, scenario.toml, map.toml and
    twin.json.
    """
    from agrobot_mj.extensions.logs.twin import FILES, summary, write_twin
    from agrobot_mj.extensions.logs.twin import twin as find
    from agrobot_mj.simulation.results import results

    scenario = _scenario(logs, base, sets)
    sources, log_map = _sources(logs, map_file)
    folder = results_folder(out, f"twin-{logs[0].stem}")
    with results(folder, FILES):
        found = find(sources, log_map, scenario, share, start, end)
        write_twin(found, folder)
    if not quiet:
        say(summary(found))
        say(folder / "report.html")


def identify(
    logs: Annotated[list[Path], typer.Argument(metavar="RUN_DIR|LOG", help="A run's folder; with --vehicle any logs.")],
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
    quiet: Quiet = False,
) -> None:
    """Fit the steering valve to a run, or a vehicle to a log.

    Prints dead band, gains, rate limit, lag and delay with their uncertainty. With --vehicle: cornering stiffness,
    understeer gradient, relaxation lengths, steering offset, delay and backlash with 95 % intervals.
    """
    if vehicle:
        options = {"names": names(fitted, "--fit"), "share": share, "start_s": start, "end_s": end}
        text = _identified_vehicle(logs, map_file, base, sets, out, options)
    else:
        text = _identified_valve(logs, out)
    if not quiet:
        say(text)


def _identified_valve(logs: list[Path], out: Path | None) -> str:
    """A table of the valve of a run."""
    from agrobot_mj.extensions.logs.identify.valve import identify_command
    from agrobot_mj.simulation.results import check_folder, results

    if len(logs) > 1:
        raise ScenarioError("identify: the valve is fitted to one run; name one, or fit the vehicle with --vehicle")
    place = logs[0] if out is None else results_folder(out, "")
    check_folder(place, ("identified.json",))
    with nullcontext() if out is None else results(place, ("identified.json",)):
        return identify_command(logs[0], place)


def _identified_vehicle(
    logs: list[Path],
    map_file: Path | None,
    base: str | None,
    sets: list[str] | None,
    out: Path | None,
    options: dict[str, Any],
) -> str:
    """A table of the vehicle of logs. Exit status 1 where they explain nothing."""
    from agrobot_mj.extensions.logs.identify.command import identify_vehicle_command
    from agrobot_mj.extensions.logs.identify.vehicle import NothingExplainedError

    scenario = _scenario(logs, base, sets)
    sources, log_map = _sources(logs, map_file)
    folder = (logs[0] if logs[0].is_dir() else None) if out is None else results_folder(out, "")
    try:
        return identify_vehicle_command(sources, log_map, scenario, folder, **options)
    except NothingExplainedError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(1) from None


def _scenario(logs: list[Path], base: str | None, sets: list[str] | None) -> "Scenario":
    """The scenario named, or that beside the first log, or the defaults on level ground; with overrides."""
    from agrobot_mj.scenario.loading import load_scenario

    log = logs[0]
    beside = (log if log.is_dir() else log.parent) / "scenario.toml"
    if base is None and beside.is_file() and (log.is_dir() or log.name in ("signals.parquet", "link.parquet")):
        return load_scenario(beside, overrides(sets))
    return load_scenario(base or "straight_line", overrides(sets))


def _sources(logs: list[Path], map_file: Path | None) -> "tuple[list[Source], LogMap]":
    """The logs as their readers return them, and the map of all."""
    from agrobot_mj.extensions.logs.maps import read_map
    from agrobot_mj.extensions.logs.readers import open_log

    log_map = read_map(map_file) if map_file is not None else None
    found = [open_log(log) for log in logs]
    maps = [log_map or each.checked_map() for each in found]
    if other := [log for log, each in zip(logs, maps, strict=True) if each != maps[0]]:
        raise ScenarioError(f"{other[0]}: has other columns than {logs[0]}; take one kind of log at a time, or a --map")
    return [each.source for each in found], maps[0]


COMMANDS = {
    identify: ("identify runs/mine", "identify field.csv --map map.toml --vehicle --machine row_crop"),
    replay: ("replay field.csv --map map.toml --describe", "replay field.csv --map map.toml --machine row_crop"),
    calibrate: ("calibrate field.csv --map map.toml --set tractor.wheelbase_m=2.1 --out calibration",),
    twin: ("twin field.csv --map map.toml --machine row_crop --out mine",),
}
"""Commands of this extension, each with examples of its use."""
