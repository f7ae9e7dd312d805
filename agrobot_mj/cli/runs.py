"""Commands `run`, which simulates one scenario, and `compare`, which compares laws, variants, plants and seeds.

Example of `--variant`: `worn: steering.valve.dead_band_v=0.8, path.points=[[0, 0], [9, 0]]`.
"""

import sys
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agrobot_mj.cli.interrupts import stop_on_signals
from agrobot_mj.cli.options import (
    Answer,
    Jobs,
    NoRrd,
    Out,
    Quiet,
    Seeds,
    Sets,
    Source,
    names,
    overrides,
    results_folder,
)
from agrobot_mj.cli.output import print_hints
from agrobot_mj.core.errors import ScenarioError

if TYPE_CHECKING:
    from agrobot_mj.recording import Recording
    from agrobot_mj.simulation.log import Log

Live = Annotated[bool, typer.Option("--live", help="Show the run live in a Rerun viewer.")]


def run(
    source: Source, sets: Sets = None, out: Out = None, no_rrd: NoRrd = False, live: Live = False, quiet: Quiet = False
) -> Answer:
    """Simulate one scenario."""
    from agrobot_mj.metrics.lag import lag_of
    from agrobot_mj.metrics.success import error_of
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.simulation.progress import Progress, print_elapsed
    from agrobot_mj.simulation.results import results
    from agrobot_mj.simulation.run import run as run_scenario
    from agrobot_mj.simulation.storage import can_record, files_of_run, write_log
    from agrobot_mj.studies.engine.workers import compiling_beside

    scenario = load_scenario(source, overrides(sets))
    folder = results_folder(out, f"{scenario.name}-{scenario.hash8}")
    recorded = not no_rrd and can_record()
    waiting = ExitStack()
    watchers = (*(() if quiet else (Progress(waiting.close),)), *recordings(folder, recorded, live))
    said = print_hints([scenario], quiet)
    with waiting, results(folder, files_of_run(scenario)), stop_on_signals() as stopped, compiling_beside(scenario):
        waiting.enter_context(print_elapsed(f"{scenario.name}: starting, which compiles the first time", quiet))
        log = run_scenario(scenario, watchers, stopped)
        write_log(log, folder, recorded=recorded)
    rms = error_of({**log.metrics, "outcome": log.outcome, "expected": log.as_expected}, "lateral_rms")
    follows = scenario.guidance.using(scenario.controller).follows_path
    lag = lag_of(log) if follows and log.outcome in ("completed", "unfinished") else None
    about = [*([] if rms is None else [f"lateral rms {rms:.3f} m"]), *([lag.text] if lag and lag.text else [])]
    found = answer(log, folder, said, about)
    return found._replace(content={**found.content, "lag": lag and lag._asdict()})


def recordings(folder: Path, recorded: bool, live: bool) -> "tuple[Recording, ...]":
    """Return the Rerun recorder of a run, for a file, a live viewer or both. The tuple is empty without a recorder."""
    from agrobot_mj.simulation.storage import RECORDING, can_record

    if not live and not (recorded and can_record()):
        return ()
    from agrobot_mj.recording import Recording

    return (Recording(folder / RECORDING if recorded else None, live=live),)


def answer(log: "Log", folder: Path, hints: list[str], about: list[str]) -> Answer:
    """Return the result of a command that simulated one run. The texts `about` follow the outcome in the first line."""
    from agrobot_mj.metrics.safety import drift_text
    from agrobot_mj.simulation.diagnosis import attribution

    s, metrics = log.scenario, log.metrics
    if rejected := metrics.get("rejected_readings"):
        counts = ", ".join(f"{name} {count}" for name, count in rejected.items())
        print(f"{s.name}: non-finite measurements were treated as missing: {counts}", file=sys.stderr)
    end = {"scenario": s.name, "seed": s.seed, "outcome": log.outcome, "expected": log.as_expected}
    parts = attribution(metrics) if s.guidance.using(s.controller).follows_path else ""
    warnings = [f"{s.name}: {text}" for text in (metrics.get("estimate_warning"), drift_text(metrics)) if text]
    lines = [", ".join([f"{s.name}: {log.outcome}", *about, str(folder)]), *([parts] if parts else []), *warnings]
    content = {**end, "folder": str(folder), "hints": [*hints, *warnings], "attribution": parts, "metrics": metrics}
    return Answer(content, "\n".join(lines), _outcome_warning(log))


def _outcome_warning(log: "Log") -> str:
    """Return a message about an unexpected outcome, or an empty string for an outcome that the scenario expects."""
    if log.as_expected:
        return ""
    s, t = log.scenario, log.column("t")
    end = t[-1] if len(t) else 0.0
    faults = ", ".join(dict.fromkeys(fault.kind for fault in s.fault if fault.active(end)))
    during = f" during {faults}" if faults else ""
    why = f" ({log.metrics['stop_reason']})" if "stop_reason" in log.metrics else ""
    return f"{s.name}: {log.outcome} after {end:.2f} s{during}{why}; expected_outcome is {s.expectation}"


def compare(
    source: Source,
    controllers: Annotated[
        str | None,
        typer.Option(help="Comma-separated controller kinds. Default: pd,pd_t2fnn if no law is given."),
    ] = None,
    guidance: Annotated[str | None, typer.Option(help="Comma-separated guidance kinds.")] = None,
    variant: Annotated[
        list[str] | None,
        typer.Option("--variant", metavar='"NAME: KEY=VALUE"', help="Named overrides, comma-separated; repeatable."),
    ] = None,
    plants: Annotated[
        str | None,
        typer.Option(help="Comma-separated plant kinds. Default: bicycle,mujoco where supported."),
    ] = None,
    seeds: Seeds = 1,
    max_runs: Annotated[int, typer.Option(min=1, help="Maximum number of planned runs.")] = 2000,
    jobs: Jobs = None,
    sets: Sets = None,
    out: Out = None,
    no_rrd: NoRrd = False,
    quiet: Quiet = False,
) -> Answer:
    """Compare several laws, variants and plants on one scenario.

    Writes one folder per run, comparison.json, and the paper's figures. The same command resumes an interrupted
    comparison.
    """
    from agrobot_mj.metrics.success import failures
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.studies.compare import compare as drive_all
    from agrobot_mj.studies.compare import conclusion, legend, notes, table
    from agrobot_mj.studies.compare_plan import plan

    scenario = load_scenario(source, overrides(sets))
    kinds = {"--controllers": controllers, "--guidance": guidance, "--plants": plants}
    inner, outer, machines = (None if text is None else names(text, option) for option, text in kinds.items())
    planned = plan(scenario, inner, outer, variants(variant), machines, seeds, max_runs)
    planned.recorded = not no_rrd
    if left_out := planned.left_out:
        print(*left_out, sep="\n", file=sys.stderr)
    said = print_hints((case.scenario for case in planned.cases[::seeds]), quiet)
    folder = results_folder(out, f"{scenario.name}-compare-{scenario.hash8}")
    rows = drive_all(planned, folder, jobs, quiet)
    shown, remarks = table(rows), [*notes(rows), *conclusion(rows)]
    text = "\n".join([shown, *legend(shown), *remarks, f"figures and runs: {folder}"])
    hints = [*said, *remarks]
    content = {"scenario": scenario.name, "folder": str(folder), "left_out": left_out, "hints": hints, "rows": rows}
    return Answer(content, text, f"{scenario.name}: failed {failed}" if (failed := failures(rows)) else "")


if TYPE_CHECKING:
    from agrobot_mj.studies.sweep.schema import SweepVariant

LONGEST_NAME = 60  # Maximum number of characters of a variant's name
BRACKETS = set("[]{}\"'")  # Characters that mark a value as TOML instead of a bare word
FORM = '"name: key=value, key=value"'


def variants(texts: list[str] | None) -> "list[SweepVariant]":
    """Return the variants from the texts of `--variant`, in order. Raises `ScenarioError` for an invalid text."""
    return [_variant(text) for text in texts or []]


def _variant(text: str) -> "SweepVariant":
    from agrobot_mj.scenario.overrides import absolute_value
    from agrobot_mj.studies.sweep.schema import SweepVariant

    name, colon, rest = text.partition(":")
    name = name.strip()
    if not colon or not name or "=" in name:
        raise ScenarioError(f"--variant {text!r}: the variant must have the form {FORM}")
    if len(name) > LONGEST_NAME or not name.isprintable():
        raise ScenarioError(f"--variant {name!r}: the name must have at most {LONGEST_NAME} printable characters")
    found: dict[str, Any] = {}
    for key, value in _items(rest, name):
        if key in found:
            raise ScenarioError(f"--variant {name!r}: {key} is given twice; specify it once")
        found[key] = absolute_value(key, value, Path.cwd())
    return SweepVariant(name=name, set=found)


def _items(text: str, name: str) -> Iterator[tuple[str, Any]]:
    """Yield keys and values of a text `KEY=VALUE, ...`. A value is a bare word, or TOML that may contain commas."""
    item, fault = "", ""
    for part in text.split(","):
        item += part
        key, equals, value = (piece.strip() for piece in item.partition("="))
        if not item.strip():
            continue
        if not equals or not key or not value:
            raise ScenarioError(f"--variant {name!r}: {item.strip()!r}: the override must have the form key=value")
        try:
            yield key, tomllib.loads(f"v = {value}")["v"]
        except tomllib.TOMLDecodeError as error:
            if BRACKETS & set(value) or not value.isprintable():
                item, fault = f"{item},", f"--variant {name!r}: {key}: not valid TOML: {error}"
                continue
            yield key, value
        item = ""
    if item.strip():
        raise ScenarioError(fault)
