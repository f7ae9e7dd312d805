"""Commands that study a part: tyres on the rig, the plants against theory, gains."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agrobot_mj.cli.interrupts import interruptible
from agrobot_mj.cli.options import SEEDS, Jobs, Out, Quiet, Sets, Source, overrides, results_folder
from agrobot_mj.cli.output import error_printer, print_hints, say

if TYPE_CHECKING:
    from agrobot_mj.bench.manoeuvres import Check


def rig(
    tyre: Annotated[str, typer.Argument(metavar="TYRE", help="A tyre kind, e.g. magic_formula, or a TOML file.")],
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Test one tyre on the rig: force curves and figures."""
    from agrobot_mj.bench.rig import rig_command

    folder = results_folder(out, f"rig-{Path(tyre).stem}")
    for path in rig_command(tyre, folder):
        if not quiet:
            say(path)


def validate(
    out: Out = None,
    quick: Annotated[bool, typer.Option("--quick", help="Shorter manoeuvres, half a minute in all.")] = False,
    quiet: Quiet = False,
) -> None:
    """Drive manoeuvres with a known answer on every plant.

    Every tyre is tested; the exit status is 1 when a number leaves its band.
    """
    from agrobot_mj.bench.manoeuvres import validate as drive_all

    def tell(name: str, checks: "list[Check]", duration: float) -> None:
        passed = sum(check.passed for check in checks)
        if not quiet:
            say(f"{name:20} {passed:3} of {len(checks):3} as they should be, {duration:.0f} s")

    folder = results_folder(out, "validation")
    failed = [check for check in drive_all(folder, quick, tell) if not check.passed]
    if not quiet:
        say(f"table and figures: {folder}")
    for check in failed:
        print(check.line, file=sys.stderr)
    if failed:
        raise typer.Exit(1)


def tune(
    source: Source,
    guidance: Annotated[str | None, typer.Option(metavar="KIND", help="The law; the scenario's if left out.")] = None,
    cases: Annotated[
        str, typer.Option(metavar="TUNING", help="Cases: surfaces, gains (of the search for all laws), or a file.")
    ] = "surfaces",
    budget: Annotated[
        int | None, typer.Option(min=8, help="Evaluations of the objective; as TUNING says by default.")
    ] = None,
    seeds: Annotated[int | None, SEEDS] = None,
    jobs: Jobs = None,
    sets: Sets = None,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Search the gains of a guidance law.

    They are judged on other cases and seeds; tuning.json says how they came about. Broken off, the same
    command goes on.
    """
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.simulation.progress import tally
    from agrobot_mj.studies.tune import tune as search
    from agrobot_mj.studies.tuning_cases import read_tuning, tuning_cases

    kind = {} if guidance is None else {"guidance.kind": guidance}
    scenario = load_scenario(source, {**kind, **overrides(sets)})
    file = read_tuning(cases)
    folder = results_folder(out, f"tune-{scenario.name}-{scenario.guidance.kind}")
    parts = ("training", "test")
    print_hints((case.scenario for part in parts for case in tuning_cases(scenario, file, part, 1)), quiet)
    evaluations = budget or file.budget
    with interruptible(), tally(f"{scenario.law}: {evaluations} evaluations", evaluations, quiet=quiet) as advance:
        found = search(scenario, file, folder, budget, seeds, jobs, None, advance, error_printer())
    if not quiet:
        for part in parts:
            now, before = (_score(found[part], name) for name in ("score", "score_before"))
            say(f"{part}: {now}, before {before}")
        say(" ".join(f"--set {key}={value:g}" for key, value in found["gains"].items()))
        say(folder / "tuning.json")


def _score(part: dict[str, Any], name: str) -> str:
    """A mean cost, with how many runs failed."""
    failed = part[name]["failed"]
    return f"{part[name]['mean']:.3f}" + (f" (failed {failed})" if failed else "")
