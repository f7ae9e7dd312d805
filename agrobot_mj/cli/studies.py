"""Commands that study a part: tyres on the rig, the plants against theory, gains."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agrobot_mj.cli.hints import tell_doubts
from agrobot_mj.cli.interrupts import interruptible
from agrobot_mj.cli.options import Out, Plugins, Quiet, Sets, Source, load_plugins, overrides, results_folder
from agrobot_mj.cli.output import say

if TYPE_CHECKING:
    from agrobot_mj.studies.validation import Check


def rig(
    tyre: Annotated[str, typer.Argument(metavar="TYRE", help="A tyre kind, e.g. magic_formula, or a TOML file.")],
    plugins: Plugins = None,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Test one tyre on the rig: force curves and figures."""
    from agrobot_mj.studies.rig import rig_command

    load_plugins(plugins)
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
    from agrobot_mj.studies.validation import validate as drive_all

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
    budget: Annotated[int, typer.Option(min=8, help="Evaluations of the objective, the same for every law.")] = 64,
    seeds: Annotated[int, typer.Option(min=1, help="Seeds of each surface and speed.")] = 2,
    jobs: Annotated[int, typer.Option(min=1, max=1000, help="Processes.")] = 1,
    sets: Sets = None,
    plugins: Plugins = None,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Search the gains of a guidance law.

    They are judged on other surfaces and seeds; tuning.json says how they came about.
    """
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.simulation.progress import task
    from agrobot_mj.simulation.storage import claimed
    from agrobot_mj.studies.tune import tune as search
    from agrobot_mj.studies.tune import tuning_cases, write_tuning

    load_plugins(plugins)
    kind = {} if guidance is None else {"guidance.kind": guidance}
    scenario = load_scenario(source, {**kind, **overrides(sets)})
    folder = results_folder(out, f"tune-{scenario.name}-{scenario.guidance.kind}")
    tell_doubts((case.scenario for part in ("training", "test") for case in tuning_cases(scenario, part, 1)), quiet)
    with claimed(folder, ("tuning.json",)), interruptible():
        with task(f"{scenario.guidance.kind}: {budget} evaluations", budget) as advance:
            found = search(scenario, budget, seeds, jobs, lambda evaluations: [advance() for _ in range(evaluations)])
        path = write_tuning(found, folder)
    if not quiet:
        for part in ("training", "test"):
            now, before = (_score(found.provenance[part], name) for name in ("score", "score_of_defaults"))
            say(f"{part}: {now}, before {before}")
        say(" ".join(f"--set {key}={value:g}" for key, value in found.gains.items()))
        say(path)


def _score(part: dict[str, Any], name: str) -> str:
    """A mean cost, with how many runs failed."""
    failed = part[name]["failed"]
    return f"{part[name]['mean']:.3f}" + (f" (failed {failed})" if failed else "")
