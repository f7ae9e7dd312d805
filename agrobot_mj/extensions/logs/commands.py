"""Command `twin` for logs of real and simulated machines."""

from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from agrobot_mj.cli.options import (
    Answer,
    Out,
    Quiet,
    Sets,
    finite,
    names,
    number,
    overrides,
    results_folder,
)
from agrobot_mj.cli.panels import help_entry

if TYPE_CHECKING:
    from agrobot_mj.scenario.schema import Scenario

PAGE = "docs/extensions/logs/replay.md"
Logs = Annotated[
    list[Path], typer.Argument(metavar="LOG", help=f"Logs of one machine ({PAGE}), or the folder of a run.")
]


Only = Annotated[
    list[str] | None,
    typer.Option(metavar="PART,PART", help="Run only calibrate, identify, keys, replay or valve (of a run)."),
]
MapFile = Annotated[
    Path | None, typer.Option("--map", metavar="MAP.toml", help=f"Map of the columns ({PAGE}), except for own logs.")
]
Share = Annotated[
    float,
    typer.Option(
        min=0.2, max=0.9, callback=finite, help="Fraction of the logs for the fit; the rest is for evaluation."
    ),
]
Fitted = Annotated[str, typer.Option("--fit", help="Parameters to identify, or scenario keys for --only keys.")]
By = Annotated[
    Literal["steer", "valve"] | None,
    typer.Option("--by", help="Recorded input of a replay. Default: the wheel angle."),
]
Start = Annotated[
    float,
    typer.Option("--from", min=0, metavar="S", callback=finite, help="Start of the evaluated part of the log [s]."),
]
End = Annotated[
    float, typer.Option("--to", metavar="S", callback=number, help="End of the evaluated part of the log [s].")
]
Described = Annotated[bool, typer.Option("--describe", help="Only describe the columns and possible uses of the log.")]


def twin(
    logs: Logs,
    only: Only = None,
    map_file: MapFile = None,
    sets: Sets = None,
    share: Share = 0.6,
    fitted: Fitted = "front,rear,relaxation,offset,delay,backlash",
    by: By = None,
    start: Start = 0.0,
    end: End = inf,
    described: Described = False,
    out: Out = None,
    quiet: Quiet = False,
) -> Answer:
    """Identify a machine from its logs and replay them.

    Sizes and masses come from --machine and --set. Writes report.html, machine.toml, scenario.toml, map.toml and
    twin.json. Parts: calibrate estimates centre and scale of the steering sensor, latencies and the antenna position;
    identify fits stiffnesses, steering offset, delay and backlash; keys fits any scenario key; replay simulates a plant
    with the recorded steering and speed; valve fits the steering valve to a run.
    """
    from agrobot_mj.core.errors import ScenarioError
    from agrobot_mj.core.table_columns import FieldLogError
    from agrobot_mj.extensions.logs.parts import Job, analyse, chosen_parts
    from agrobot_mj.simulation.progress import print_elapsed

    if described:
        texts = _describe_logs(logs, map_file)
        return Answer({"logs": texts}, "\n\n".join(texts))
    if not start < end:
        raise ScenarioError(f"--from {start:g} --to {end:g}: the end must be later than the start")
    chosen = names(",".join(only), "--only") if only else []
    parts = chosen_parts(chosen)
    folder, scenario = _folder(out, chosen, logs[0]), _scenario(logs[0], sets)
    for part in parts.values():
        part.check(scenario, names(fitted, "--fit"))
    options = {"names": names(fitted, "--fit"), "share": share, "start_s": start, "end_s": end, "by": by}
    job = Job(logs, map_file, scenario, **options)
    with print_elapsed(f"{logs[0].name}: analysing", quiet):
        lines = [] if chosen == ["valve"] else list(job.health)
        try:
            found = analyse(parts, job, folder)
        except FieldLogError as error:
            raise ScenarioError("\n".join([str(error), *lines])) from None
    lines += [line for each in found.values() for line in each.lines]
    if folder is not None and any(each.content for each in found.values()):
        lines.append(str(folder if chosen else folder / "report.html"))
    content = {"folder": folder and str(folder), **{name: each.content or None for name, each in found.items()}}
    return Answer(content, "\n".join(lines), "\n".join(each.failed for each in found.values() if each.failed))


def _describe_logs(logs: list[Path], map_file: Path | None) -> list[str]:
    """Return a description of each log, including its possible uses."""
    from agrobot_mj.extensions.logs.maps import read_map
    from agrobot_mj.extensions.logs.readers import open_log
    from agrobot_mj.extensions.logs.readers.describe import describe

    own = read_map(map_file) if map_file else None
    return [describe(open_log(log), own) for log in logs]


def _folder(out: Path | None, parts: list[str], log: Path) -> Path | None:
    """Return the folder for result files, or None if no files are written. Without `out`, results of the identification
    of a simulated run go to the folder of this run. Calibration and fits to other logs write no files."""
    if out is None and parts and "replay" not in parts:
        identified = "calibrate" not in parts and (log / "signals.parquet").is_file()
        return log if identified else None
    return results_folder(out, f"{'replay' if parts else 'twin'}-{log.stem}")


def _scenario(log: Path, sets: list[str] | None) -> "Scenario":
    """Return the scenario in the folder of the log, by default `straight_line`, with the overrides `sets`."""
    from agrobot_mj.scenario.loading import load_scenario

    beside = (log if log.is_dir() else log.parent) / "scenario.toml"
    own = beside.is_file() and (log.is_dir() or log.name in ("signals.parquet", "link.parquet"))
    return load_scenario(beside if own else "straight_line", overrides(sets))


COMMANDS = {
    twin: help_entry(
        "Field logs",
        "twin field.csv --map map.toml --machine row_crop --out mine",
        "twin field.csv --map map.toml --describe",
        "twin field.csv --map map.toml --only calibrate --set tractor.wheelbase_m=2.1",
        "twin field.csv --map map.toml --only keys --fit plant.tyre.front.lateral.stiffness_per_load",
        "twin runs/mine --only valve",
        former={
            "calibrate": "twin --only calibrate",
            "replay": "twin --only replay",
            "identify --vehicle": "twin --only identify",
            "identify": "twin --only valve",
        },
    ),
}
"""Commands of the extension for logs, with their help entries."""
