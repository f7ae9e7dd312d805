"""Parts of the analysis by `agrobot-mj twin`. Each part returns text lines, the content of a JSON file, and further
files."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.table_columns import Source, load_table
from agrobot_mj.extensions.logs.calibrate import Calibration, calibrate
from agrobot_mj.extensions.logs.health import health_lines
from agrobot_mj.extensions.logs.identify.keys import fit_keys, start_values
from agrobot_mj.extensions.logs.identify.valve import NAMES, Identified, identify, rate_of
from agrobot_mj.extensions.logs.identify.vehicle import NothingExplainedError, fitted_parameters, identify_vehicle
from agrobot_mj.extensions.logs.identify.windows import TooLittleError
from agrobot_mj.extensions.logs.maps import LogMap, read_map
from agrobot_mj.extensions.logs.origin import log_identity
from agrobot_mj.extensions.logs.quantities import HEAD, Found, quantity_numbers, quantity_rows
from agrobot_mj.extensions.logs.readers import open_log
from agrobot_mj.extensions.logs.replay.result import files_of_replay, replay, write_replay
from agrobot_mj.extensions.logs.twin.page import FILES, write_twin
from agrobot_mj.extensions.logs.twin.twin import twin
from agrobot_mj.extensions.logs.words import (
    advice,
    map_lines,
    replay_sentences,
    sentences,
    twin_sentences,
    vehicle_sentences,
)
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.results import remove, results, write_json, write_text


class Job:
    """Logs of one machine with the options of their analysis."""

    def __init__(self, logs: list[Path], map_file: Path | None, scenario: Scenario, **options: Any) -> None:
        """Create a job. Options: time range `start_s` to `end_s` [s], fraction `share` of the logs for the fit [-],
        fitted parameters `names`, and recorded input `by` of a replay."""
        self.logs, self.map_file, self.scenario, self.options = logs, map_file, scenario, options

    @cached_property
    def opened(self) -> tuple[list[Source], LogMap]:
        """Contents of the logs, and their common column map."""
        log_map = read_map(self.map_file) if self.map_file is not None else None
        found = [open_log(log) for log in self.logs]
        maps = [log_map or each.checked_map() for each in found]
        if other := [log for log, each in zip(self.logs, maps, strict=True) if each != maps[0]]:
            more = "use one type of log at a time, or specify --map"
            raise ScenarioError(f"{other[0]}: the columns differ from the columns of {self.logs[0]}; {more}")
        return [load_table(each.source) for each in found], maps[0]

    @cached_property
    def health(self) -> list[str]:
        """Sentences about steering centre, antenna position, noise and bursts. Empty for logs without a wheel angle."""
        sources, log_map = self.opened
        return health_lines(sources, log_map) if log_map.steer is not None else []

    def identity(self, *names: str) -> str:
        """Return the identity of a result that depends on logs, column map, scenario, time range and the options
        `names`."""
        sources, log_map, scenario, options = self.given(*names)
        return log_identity(scenario, sources, log_map, **options)

    def given(self, *names: str) -> tuple[list[Source], LogMap, Scenario, dict[str, Any]]:
        """Return logs, column map, scenario, and a dictionary with start time, end time and the options `names`."""
        return *self.opened, self.scenario, {name: self.options[name] for name in ("start_s", "end_s", *names)}


class Finding(NamedTuple):
    """Result of one part of the log analysis."""

    lines: Iterable[str]
    content: Mapping[str, Any] = MappingProxyType({})  # Content of the JSON file, or empty if the part has no result
    write: Callable[[Path], object] = lambda folder: None  # Function that writes the other result files to a folder
    failed: str = ""  # Reason why the result is missing or incomplete, or an empty string


class LogPart(NamedTuple):
    """Definition of one part of the log analysis."""

    run: Callable[[Job], Finding]
    file: str  # Name of the JSON file
    others: Callable[[Scenario], tuple[str, ...]] = lambda scenario: ()
    """Function that returns the names of the additional result files for a scenario."""
    check: Callable[[Scenario, Sequence[str]], object] = lambda scenario, names: None
    """Function that raises `ScenarioError` for invalid names of fitted parameters, before the logs are read."""


def analyse(parts: Mapping[str, LogPart], job: Job, folder: Path | None) -> dict[str, Finding]:
    """Run parts of the analysis on the logs of a job. Return the results by part name, and write them to `folder`
    unless it is None."""
    names = [name for part in parts.values() for name in (part.file, *part.others(job.scenario))]
    found = dict[str, Finding]()
    with nullcontext() if folder is None else results(folder, names):
        for name, part in parts.items():
            found[name] = part.run(job)
            if folder is not None and found[name].content:
                found[name].write(folder)
                write_json(folder / part.file, found[name].content)
            elif folder is not None:
                remove(folder, (part.file, *part.others(job.scenario)))  # results of other logs would mislead
    return found


def calibration(job: Job) -> Finding:
    """Calibrate the steering sensor, latencies, heading offset and antenna position with the logs of a job."""
    sources, log_map, scenario, options = job.given()
    return _calibration(calibrate(sources, log_map, scenario, **options), scenario, job.identity())


def _calibration(found: Calibration, scenario: Scenario, identity: str) -> Finding:
    map_text, notes = map_lines(found), found.pieces.notes
    lines = [*notes, *sentences(found, scenario.tractor), "", _table(found.found, found.units), "", "The map:", ""]
    content = {
        "identity": identity,
        "found": quantity_numbers(found.found),
        "positive": found.positive,
        "windows": found.data.windows,
        "notes": list(notes),
    }
    return Finding([*lines, map_text.rstrip()], content, lambda folder: write_text(folder / "map.toml", map_text))


def vehicle(job: Job) -> Finding:
    """Identify the stiffness and relaxation length of the tyres, and the offset, delay and backlash of the steering. If
    the logs are too short, only calibrate the sensors."""
    sources, log_map, scenario, options = job.given("names", "share")
    try:
        found = identify_vehicle(sources, log_map, scenario, **options)
    except TooLittleError as error:
        lesser = calibrate(sources, log_map, scenario, options["start_s"], options["end_s"])
        lines, more = _calibration(lesser, scenario, "").lines, advice(lesser.pieces.kept, ["cornering_stiffness"])
        return Finding(["Results that this log supports:", *lines, *more], failed=str(error))
    except NothingExplainedError as error:
        return Finding((), failed=str(error))
    content = {"identity": job.identity("names", "share"), **found._asdict(), "found": quantity_numbers(found.found)}
    del content["kept"]
    return Finding([*found.notes, _table(found.found, {}), *vehicle_sentences(found, scenario.tractor)], content)


def keys(job: Job) -> Finding:
    """Fit scenario keys to the logs of a job by replays, with MuJoCo's toolbox `mujoco.sysid`."""
    sources, log_map, scenario, options = job.given("names")
    found = fit_keys(sources, log_map, scenario, **options)
    content = {"identity": job.identity("names"), **found._asdict(), "found": quantity_numbers(found.found)}
    off = [f"{name}: rms residual {a:.3g}, at the start {b:.3g}" for name, (b, a) in found.rms.items()]
    return Finding([*found.notes, _table(found.found, {}), *off], content)


def _table(found: Found, units: Mapping[str, str]) -> str:
    """Return a table of quantities with intervals, as text that is also valid Markdown."""
    return markdown_table(HEAD, quantity_rows(found, units), 1, aligned=True)


def replay_logs(job: Job) -> Finding:
    """Replay the recorded steering and speed of the logs on a plant."""
    sources, log_map, scenario, options = job.given("by")
    found = replay(sources, log_map, scenario, **options)
    found = found._replace(metrics={"identity": job.identity("by"), **found.metrics})
    stopped = [
        f"{recording.name}: the simulation of the plant ended at {driven.t[-1]:.2f} s: {driven.outcome}"
        for recording, driven in found.pieces
        if driven.outcome != "completed"
    ]
    lines = replay_sentences(found, scenario.tractor)
    return Finding(
        lines, found.metrics, lambda folder: write_replay(found, scenario, folder), failed="\n".join(stopped)
    )


def valve(job: Job) -> Finding:
    """Identify the steering valve from the folder of a single run."""
    run = job.logs[0]
    if len(job.logs) > 1:
        raise ScenarioError("--only valve: the valve model is fitted to a single run; specify only one folder")
    if not run.is_dir():
        raise ScenarioError(f"--only valve: {run} is not a folder; specify the folder of a run")
    signals, scenario = run / "signals.parquet", job.scenario
    if not signals.is_file():
        raise ScenarioError(f"{run}: the folder has no signals.parquet; specify the folder of a run")
    try:
        found = identify(signals, scenario.steering.cylinder, scenario.tractor.steer_limit_deg)
    except ScenarioError as error:
        raise ScenarioError(f"{signals}: {str(error).removeprefix(f'{signals.name}: ')}") from None
    content = {"identity": log_identity(scenario, [signals]), **found._asdict()}
    return Finding(_valve_lines(found, scenario if (run / "scenario.toml").is_file() else None), content)


def _valve_lines(found: Identified, scenario: Scenario | None) -> list[str]:
    """Return a table of identified values with standard errors and, if given, scenario values, followed by comments."""
    known = dict[str, float]()
    if scenario is not None:
        own, cylinder = scenario.steering.valve, scenario.steering.cylinder
        known = own.model_dump() | {"rate_limit_deg_s": rate_of(own.largest_flow, cylinder)}
        known |= {"backlash_deg": scenario.steering.linkage.backlash_deg}
    rows = [
        (name, _text(getattr(found, name), "not identified"), _text(found.errors.get(name)), _text(known.get(name)))
        for name in NAMES
    ]
    lines = [markdown_table(("parameter", "identified", "std error", "scenario"), rows, 1, aligned=True)]
    if found.rate_limit_deg_s is None:
        lines.append(
            f"The run does not reach the rate limit; the maximum steering rate is {found.rate_reached_deg_s:.3g} deg/s."
        )
    share, rms = 100 * found.explained, found.residual_rms_deg
    return [*lines, f"The fit explains {share:.2f} % of the motion; the residual is {rms:.3f} deg rms."]


def _text(value: float | None, absent: str = "-") -> str:
    return absent if value is None else f"{value:.4g}"


def whole(job: Job) -> Finding:
    """Calibrate the sensors and identify the vehicle with the first part of the logs, and replay the other part."""
    sources, log_map, scenario, options = job.given("share")
    found = twin(sources, log_map, scenario, **options)
    content = {
        "identity": found.identity,
        "log": found.name,
        "machine": found.scenario.machine,
        "found": quantity_numbers(found.found),
        "windows": found.calibration.data.windows,
        "held_out": found.held_out.metrics,
        "notes": list(found.calibration.pieces.notes),
    }
    return Finding(twin_sentences(found), content, lambda folder: write_twin(found, job.health, folder))


PARTS = {
    "calibrate": LogPart(calibration, "calibration.json", lambda scenario: ("map.toml",)),
    "identify": LogPart(vehicle, "vehicle.json", check=lambda scenario, names: fitted_parameters(names)),
    "keys": LogPart(keys, "keys.json", check=start_values),
    "replay": LogPart(replay_logs, "replay.json", files_of_replay),
    "valve": LogPart(valve, "identified.json"),
}
"""Parts of the analysis that the option `--only` selects, by name."""
WHOLE = {"twin": LogPart(whole, "twin.json", lambda scenario: FILES)}
"""Default analysis, which includes calibration, identification, replay and report."""


def chosen_parts(names: Sequence[str]) -> dict[str, LogPart]:
    """Return the log analyses `names` of `PARTS`, by default `WHOLE`. Raises `ScenarioError` for unknown names."""
    if unknown := next((name for name in names if name not in PARTS), None):
        near = suggestion(unknown, list(PARTS))
        raise ScenarioError(f"--only {unknown}: unknown part{near} (known: {', '.join(PARTS)})")
    return {name: PARTS[name] for name in names} or WHOLE
