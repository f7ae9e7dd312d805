"""Commands that look for failures: how rare one is, and the mildest combination that leads to one."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agrobot_mj.cli.answers import Answer
from agrobot_mj.cli.interrupts import interruptible
from agrobot_mj.cli.options import Jobs, Out, Quiet, Seeds, Sets, Source, finite, overrides, results_folder, utf8
from agrobot_mj.cli.output import error_printer, print_hints, say
from agrobot_mj.core.errors import ScenarioError, shortened

if TYPE_CHECKING:
    from agrobot_mj.studies.falsify import Combination, Varied
    from agrobot_mj.studies.risk.population import Population

Until = Annotated[str, typer.Option(metavar="CONDITION", help="When a run counts as failed.")]
Score = Annotated[
    str | None,
    typer.Option(metavar="SIGNAL", help="Signal whose size tells how close a run is; CONDITION's if left out."),
]


def risk(
    source: Source,
    until: Until,
    particles: Annotated[int, typer.Option(min=2, max=10_000, help="Runs that are split together.")] = 50,
    repeats: Annotated[int, typer.Option(min=2, max=1000, help="Independent splittings, for the interval.")] = 10,
    score: Score = None,
    least: Annotated[float, typer.Option(callback=finite, help="Probability below which to give up.")] = 1e-6,
    jobs: Jobs = None,
    sets: Sets = None,
    out: Out = None,
    quiet: Quiet = False,
) -> Answer:
    """Estimate how rare a failure is, down to one run in a million.

    CONDITION is such as "xte_abs_max > 0.3". Runs that come close are split: their noise goes on in several ways.
    Writes risk.json, risk.png and the recording of a failure, and resumes.
    """
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.studies.risk import RiskQuestion, content
    from agrobot_mj.studies.risk import risk as search

    scenario = load_scenario(source, overrides(sets))
    folder = results_folder(out, f"risk-{scenario.name}")
    about = {"folder": str(folder), "hints": print_hints([scenario], quiet)}

    def tell(population: "Population") -> None:
        if not quiet and (found := population.split):
            say(f"{population.number + 1} of {repeats}: {found.probability:.2g} in {found.paths} runs")

    question = RiskQuestion(until, particles, repeats, score, least)
    with interruptible():
        found = search(scenario, question, folder, jobs, tell, error_printer())
    return Answer({**content(scenario, question, found), **about}, f"{found.statement}\n{folder / 'risk.json'}")


def falsify(
    source: Source,
    vary: Annotated[
        list[str],
        typer.Option(metavar="KEY=MILD:HARD", help="A key and its range, or KEY={normal=[MEAN, SD]}; repeatable."),
    ],
    until: Until,
    budget: Annotated[int, typer.Option(min=20, help="Combinations of the search.")] = 150,
    seeds: Seeds = 3,
    score: Score = None,
    jobs: Jobs = None,
    sets: Sets = None,
    out: Out = None,
    quiet: Quiet = False,
) -> Answer:
    """Search the mildest combination of changes that fails.

    Distances count in units of each range or spread. Writes falsify.json, falsify.png and the recording of the failure,
    with its scenario, and resumes.
    """
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.studies.falsify import FalsifyQuestion, content
    from agrobot_mj.studies.falsify import falsify as search

    scenario = load_scenario(source, overrides(sets))
    question = FalsifyQuestion(tuple(map(_varied, vary)), until, budget, seeds, score)
    folder = results_folder(out, f"falsify-{scenario.name}")
    about = {"folder": str(folder), "hints": print_hints([scenario], quiet)}

    def tell(tried: "Combination") -> None:
        if not quiet:
            say(f"{tried.shown}: {tried.share} fail, closeness {tried.close:.3g}")

    with interruptible():
        found = search(scenario, question, folder, jobs, tell, error_printer())
    return Answer({**content(scenario, question, found), **about}, f"{found.statement}\n{folder / 'falsify.json'}")


def _varied(text: str) -> "Varied":
    """A key with its range or spread, from `KEY=MILD:HARD` or `KEY={normal = [MEAN, SD]}`."""
    from agrobot_mj.studies.falsify import Varied

    key, _, value = utf8(text, "--vary").partition("=")
    key = key.strip()
    made: Callable[[str, float, float], Varied] = Varied.ranged
    try:
        if value.lstrip().startswith("{"):
            draws: dict[str, Any] = overrides([text], "--vary")[key]
            ((kind, numbers),) = draws.items()
            made = {"normal": Varied.spread}[kind]
        else:
            numbers = value.split(":")
        first, second = map(float, numbers)
    except (AttributeError, LookupError, TypeError, ValueError):
        form = "KEY=MILD:HARD, or as 'KEY={normal=[MEAN, SD]}'"
        raise ScenarioError(f"--vary {shortened(text)}: write it as {form}") from None
    return made(key, first, second)
