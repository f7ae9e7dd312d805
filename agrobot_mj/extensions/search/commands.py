"""Commands that search for limits, rare failures, smallest failing changes, important parameters, and gains."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agrobot_mj.cli.options import (
    SEEDS,
    Answer,
    Jobs,
    Out,
    Quiet,
    Seeds,
    Sets,
    Source,
    finite,
    names,
    overrides,
    results_folder,
    utf8,
)
from agrobot_mj.cli.output import print_hints, say
from agrobot_mj.cli.panels import help_entry
from agrobot_mj.core.errors import ScenarioError, shorten

if TYPE_CHECKING:
    from agrobot_mj.extensions.search.falsify.search import Combination, Varied
    from agrobot_mj.extensions.search.limit.question import Tried
    from agrobot_mj.extensions.search.risk.population import Population


Until = Annotated[str, typer.Option(metavar="CONDITION", help="Failure condition, e.g. 'xte_rms > 0.3'.")]


def limit(
    source: Source,
    key: Annotated[str, typer.Option(metavar="KEY", help="Dotted key to vary, e.g. terrain.grade_deg.")],
    range_: Annotated[
        str, typer.Option("--range", metavar="A:B", help="Range from a value A, where the law succeeds, to B.")
    ],
    until: Until,
    guidance: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND,KIND", help="Guidance laws; repeatable. Default: the law of the scenario."),
    ] = None,
    max_seeds: Annotated[int, typer.Option(min=1, help="Maximum seeds per value; at least 12 for the last two.")] = 12,
    reliability: Annotated[float, typer.Option(callback=finite, help="Fraction of runs that must succeed.")] = 0.8,
    confidence: Annotated[float, typer.Option(callback=finite, help="Confidence of the result.")] = 0.8,
    tolerance: Annotated[
        float | None, typer.Option(callback=finite, help="Width of the final interval. Default: range / 50.")
    ] = None,
    beside: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="Override for the baseline without the disturbance; repeatable."),
    ] = None,
    jobs: Jobs = None,
    sets: Sets = None,
    out: Out = None,
    quiet: Quiet = False,
) -> Answer:
    """Search for the value of a key at which a law fails.

    Example of a CONDITION: "lateral_rms > 0.3 or outcome != completed". Writes limit.json and limit.png. The same
    command resumes an interrupted search.
    """
    from agrobot_mj.extensions.search.limit.question import Question
    from agrobot_mj.extensions.search.limit.search import content
    from agrobot_mj.extensions.search.limit.search import limit as search
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.simulation.progress import print_elapsed

    kinds = names(",".join(guidance), "--guidance") if guidance else []
    scenario = load_scenario(source, overrides(sets))
    folder = results_folder(out, f"limit-{scenario.name}-{key}")
    question = Question(key, *_ends(range_), until, max_seeds, reliability, confidence, tolerance)
    sound, said = overrides(beside, "--beside") if beside else None, list[str]()
    tell, hint = partial(_tell, key, quiet), lambda ends: said.extend(print_hints(ends, quiet))
    with print_elapsed(f"{scenario.name}: searching", quiet):
        found = search(scenario, question, kinds, folder, jobs, tell, hint, sound)
    lines = [each.statement + (f"\n  {each.beside.statement}" if each.beside else "") for each in found]
    about = {"folder": str(folder), "hints": said}
    return Answer({**content(scenario, question, found), **about}, "\n".join([*lines, str(folder / "limit.json")]))


def _tell(key: str, quiet: bool, law: str, tried: "Tried") -> None:
    ends = f" ({tried.ends})" if tried.unexpected else ""
    if not quiet:
        say(f"{law}: {key} = {tried.value:g}: {tried.share} succeed{ends}")


def _ends(text: str) -> tuple[float, float]:
    first, colon, last = text.partition(":")
    try:
        if colon:
            return float(first), float(last)
    except ValueError:
        pass
    raise ScenarioError(f"--range {text}: specify two numbers, such as 0:25")


Score = Annotated[
    str | None,
    typer.Option(metavar="SIGNAL", help="Signal that measures the margin. Default: from CONDITION."),
]


def risk(
    source: Source,
    until: Until,
    particles: Annotated[int, typer.Option(min=2, max=10_000, help="Number of simultaneous runs.")] = 50,
    repeats: Annotated[int, typer.Option(min=2, max=1000, help="Number of repetitions.")] = 10,
    score: Score = None,
    least: Annotated[float, typer.Option(callback=finite, help="Probability below which the search stops.")] = 1e-6,
    jobs: Jobs = None,
    sets: Sets = None,
    out: Out = None,
    quiet: Quiet = False,
) -> Answer:
    """Estimate the probability of a rare failure.

    Probabilities down to one in a million are possible. Example of a CONDITION: "xte_abs_max > 0.3". Runs close to
    failure are split and continued with different noise. Writes risk.json, risk.png and the recording of a failure. The
    same command resumes an interrupted estimation.
    """
    from agrobot_mj.extensions.search.risk.command import content
    from agrobot_mj.extensions.search.risk.command import risk as search
    from agrobot_mj.extensions.search.risk.splitting import RiskQuestion
    from agrobot_mj.scenario.loading import load_scenario

    scenario = load_scenario(source, overrides(sets))
    folder = results_folder(out, f"risk-{scenario.name}")
    about = {"folder": str(folder), "hints": print_hints([scenario], quiet)}

    def tell(population: "Population") -> None:
        if not quiet and (found := population.split):
            say(f"{population.number + 1} of {repeats}: probability {found.probability:.2g} from {found.paths} runs")

    question = RiskQuestion(until, particles, repeats, score, least)
    found = search(scenario, question, folder, jobs, tell, quiet)
    return Answer({**content(scenario, question, found), **about}, f"{found.statement}\n{folder / 'risk.json'}")


def falsify(
    source: Source,
    vary: Annotated[
        list[str],
        typer.Option(metavar="KEY=MILD:HARD", help="A key and its range, or KEY={normal=[MEAN, SD]}; repeatable."),
    ],
    until: Until,
    budget: Annotated[int, typer.Option(min=20, help="Number of combinations in the search.")] = 150,
    seeds: Seeds = 3,
    score: Score = None,
    jobs: Jobs = None,
    sets: Sets = None,
    out: Out = None,
    quiet: Quiet = False,
) -> Answer:
    """Search for the smallest changes that make most runs fail.

    Distances are in units of the range or standard deviation of each key. Writes falsify.json, falsify.png, and the
    recording and scenario of the failure. The same command resumes an interrupted search.
    """
    from agrobot_mj.extensions.search.falsify.command import content
    from agrobot_mj.extensions.search.falsify.command import falsify as search
    from agrobot_mj.extensions.search.falsify.search import FalsifyQuestion
    from agrobot_mj.scenario.loading import load_scenario

    scenario = load_scenario(source, overrides(sets))
    question = FalsifyQuestion(tuple(map(_varied_key, vary)), until, budget, seeds, score)
    folder = results_folder(out, f"falsify-{scenario.name}")
    about = {"folder": str(folder), "hints": print_hints([scenario], quiet)}

    def tell(tried: "Combination") -> None:
        if not quiet:
            say(f"{tried.shown}: {tried.share} fail, margin {tried.close:.3g}")

    found = search(scenario, question, folder, jobs, tell)
    return Answer({**content(scenario, question, found), **about}, f"{found.statement}\n{folder / 'falsify.json'}")


def _varied_key(text: str) -> "Varied":
    """Return a varied key with its range or distribution, from `KEY=MILD:HARD` or `KEY={normal = [MEAN, SD]}`."""
    from agrobot_mj.extensions.search.falsify.search import Varied

    key, _, value = utf8(text, "--vary").partition("=")
    key = key.strip()
    made: Callable[[str, float, float], Varied] = Varied.in_range
    try:
        if value.lstrip().startswith("{"):
            draws: dict[str, Any] = overrides([text], "--vary")[key]
            ((kind, numbers),) = draws.items()
            made = {"normal": Varied.spread}[kind]
        else:
            numbers = value.split(":")
        first, second = map(float, numbers)
    except (AttributeError, LookupError, TypeError, ValueError):
        form = "KEY=MILD:HARD or 'KEY={normal=[MEAN, SD]}'"
        raise ScenarioError(f"--vary {shorten(text)}: the range must have the form {form}") from None
    return made(key, first, second)


def tune(
    source: Source,
    guidance: Annotated[
        str | None, typer.Option(metavar="KIND", help="Guidance law. Default: the law of the scenario.")
    ] = None,
    cases: Annotated[
        str,
        typer.Option(
            metavar="TUNING", help="Cases: surfaces, gains (used for the gain search of all laws), or a file."
        ),
    ] = "surfaces",
    budget: Annotated[
        int | None, typer.Option(min=8, help="Evaluations of the objective. Default: from TUNING.")
    ] = None,
    seeds: Annotated[int | None, SEEDS] = None,
    jobs: Jobs = None,
    sets: Sets = None,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Tune the gains of a guidance law.

    The gains are then evaluated on other cases and seeds; tuning.json documents the search. The same command resumes an
    interrupted search.
    """
    from agrobot_mj.extensions.search.tune import tune as search
    from agrobot_mj.extensions.search.tuning_cases import read_tuning, tuning_cases
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.simulation.progress import tally

    kind = {} if guidance is None else {"guidance.kind": guidance}
    scenario = load_scenario(source, {**kind, **overrides(sets)})
    file = read_tuning(cases)
    folder = results_folder(out, f"tune-{scenario.name}-{scenario.guidance.kind}")
    parts = ("training", "test")
    print_hints((case.scenario for part in parts for case in tuning_cases(scenario, file, part, 1)), quiet)
    evaluations = budget or file.budget
    with tally(f"{scenario.law}: {evaluations} evaluations", evaluations, quiet=quiet) as advance:
        found = search(scenario, file, folder, budget, seeds, jobs, None, advance)
    if not quiet:
        for part in parts:
            now, before = (_score(found[part], name) for name in ("score", "score_before"))
            say(f"{part}: {now}, before {before}")
        say(" ".join(f"--set {key}={value:g}" for key, value in found["gains"].items()))
        say(folder / "tuning.json")


def _score(part: dict[str, Any], name: str) -> str:
    failed = part[name]["failed"]
    return f"{part[name]['mean']:.3f}" + (f" (failed {failed})" if failed else "")


COMMANDS = {
    limit: help_entry(
        "Compare",
        'limit side_slope_10 --key terrain.grade_deg --range 0:25 --until "xte_rms > 0.3"',
        'limit circle --key path.radius_m --range 6:2 --until "xte_rms > 0.02" --guidance lqr,stanley --json',
    ),
    risk: help_entry("Compare", 'risk side_slope_10_lqr --until "xte_abs_max > 0.4"', advanced=True),
    falsify: help_entry(
        "Compare", 'falsify lane_change --vary path.speed_m_s=1.2:3 --until "xte_abs_max > 0.3"', advanced=True
    ),
    tune: help_entry(
        "Compare",
        "tune figure_eight --guidance lqr",
        "tune my_field.toml --guidance stanley --budget 64 --seeds 2",
        advanced=True,
    ),
}
