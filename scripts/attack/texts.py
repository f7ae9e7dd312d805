"""Text: overrides, scenarios, sweeps, conditions of a limit, and numbers at the edge of what is accepted."""

import random
import warnings
from functools import cache
from math import inf, nan
from pathlib import Path
from typing import Any

from judge import LONGEST_TEXT, call

from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import sweep_files
from agrobot_mj.scenario.loading import scenario_files
from agrobot_mj.studies.limit.condition import Condition
from agrobot_mj.studies.limit.question import metric_names
from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep

SHORT = ("--no-rrd", "--quiet", "--set", "duration_s=0.5", "--set", "plant.kind=bicycle", "--out", "out")
VALUES = (
    *("nan", "inf", "-inf", "0", "-1", "1e308", "5e-324", "-0.0", "1e9", "9" * 5000, "0x" + "f" * 5000, "true", '""'),
    *("[]", "{}", "[" * 3000, '"\\u001b[31m"', '"' + "x" * 50_000 + '"', "1979-05-27", "[1, 2, 3]", "{ kind = 1 }"),
    *(
        "é",
        '"[/bold]"',
        '"../../etc/passwd"',
        "'\\\\'",
        "{ from = 0, to = 1, count = 3 }",
        "[nan]",
        "[[0]]",
        "1_0",
        "0b1",
    ),
)
"""Values that no key is meant to have."""
WORDS = ("lateral_rms", "outcome", "xte_rms", "nope", "per_turn", "__class__", "wall_s", "completed", "1e999", "nan")
WORDS = (*WORDS, "None", "'x'", "().__class__", "[1]", "lambda: 0", "-0.3", "0.3", "9" * 400, "é", "\x00", "outcome.x")
SIGNS = ("<", ">", "==", "!=", " and ", " or ", "+", "**", "not ", "(", ")", ",", " in ", " if ", ":=", "", " ", "\n")


@cache
def keys() -> tuple[str, ...]:
    """Dotted keys of the default scenario that hold a value."""
    return tuple(_below(load_scenario("figure_eight").model_dump(mode="json"), ""))


@cache
def numbers() -> tuple[tuple[str, float], ...]:
    """Keys that hold a number other than zero, with that number, but for those that make a run long."""
    flat = _flat(load_scenario("figure_eight").model_dump(mode="json"), "")
    short = ("settle", "physics_dt", "duration", "turns", "half_size", "seed", "rules_")
    return tuple((k, v) for k, v in flat if isinstance(v, float) and v and not any(part in k for part in short))


def _below(table: dict[str, Any], prefix: str) -> list[str]:
    return [key for key, _ in _flat(table, prefix)]


def _flat(table: dict[str, Any], prefix: str) -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for name, value in table.items():
        found += _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else [(prefix + name, value)]
    return found


def sets(*texts: str) -> list[str]:
    """Arguments that override keys."""
    return [word for text in texts for word in ("--set", text)]


def overrides(chance: random.Random) -> str:
    """One to three keys with odd values."""
    texts = [f"{chance.choice(keys())}={chance.choice(VALUES)}" for _ in range(chance.randint(1, 3))]
    return call(["run", "circle", *SHORT, *sets(*texts)])


def toml(chance: random.Random) -> str:
    """A scenario of the library with bytes and lines changed."""
    Path("mine.toml").write_bytes(_changed(chance, chance.choice(list(scenario_files().values()))))
    return call(["run", "mine.toml", *SHORT])


def _changed(chance: random.Random, file: Path) -> bytes:
    lines = file.read_bytes().split(b"\n")
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(lines))
        line, odd = lines[at], chance.choice(VALUES).encode()
        changed = [line[: len(line) // 2], line + line, chance.randbytes(5), line.partition(b"=")[0] + b"= " + odd, b""]
        lines[at] = chance.choice(changed)
    return b"\n".join(lines)


def sweeps(chance: random.Random) -> str:
    """A sweep with hostile axes, draws and counts: refused in words, or one of its runs, chosen by chance, runs."""
    if chance.random() < 0.3:
        Path("mine.toml").write_bytes(_changed(chance, chance.choice(list(sweep_files().values()))))
    else:
        Path("mine.toml").write_text(_sweep(chance), encoding="utf-8")
    try:
        plan = SweepPlan(read_sweep(Path("mine.toml")))
        plan.check_size(200)
        plan.check()
    except ScenarioError as error:
        return "" if 0 < len(str(error)) < 10 * LONGEST_TEXT else f"a message of {len(str(error))} characters"
    planned = plan.run(chance.randrange(plan.total))
    short = {"duration_s": 0.2, "plant.settle_limit_s": 3.0, "plant.settle_s": 0.1}
    scenario = plan.sweep.base.changed(planned.overrides)
    if scenario.plant.kind == "bicycle":
        short = {"duration_s": 0.2}
    if scenario.guidance.kind == "nmpc":
        return ""
    run(scenario.changed(short))  # a refusal here should have been one of the plan
    return ""


def _sweep(chance: random.Random) -> str:
    """The text of a sweep."""
    (key, value), (other, base) = chance.sample(numbers(), 2)
    span = chance.choice([0.5, 1.5, 3.0, 100.0, -1.0, 0.0])
    odd = chance.choice(VALUES)
    axis = chance.choice([f"[{value}, {value * span}]", f"[{odd}, {value}]", odd, "{ from = 0, to = nan, count = 3 }"])
    axis = chance.choice(
        [axis, f"{{ from = {value}, to = {value * span}, count = {chance.choice([2, 5, 0, 10**9])} }}"]
    )
    draw = chance.choice(
        [f"{{ uniform = [{base}, {base * span}] }}", f"{{ normal = [{base}, {odd}] }}", "{ choice = [] }", odd]
    )
    counts = (
        f"seeds = {chance.choice(['2', '0', '[1, 1]', '10**3', '999999999', odd])}\n" if chance.random() < 0.4 else ""
    )
    drawn = f'[draws]\n"{other}" = {draw}\n' if chance.random() < 0.5 else ""
    plant = chance.choice(["mujoco", "bicycle"])
    start = f'base = "{chance.choice(["circle", "side_slope_5", "nope"])}"\n{counts}[set]\n"plant.kind" = "{plant}"\n'
    return f'{start}[axes]\n"{key}" = {axis}\n{drawn}'


@cache
def names() -> tuple[str, ...]:
    """Metrics of a run."""
    return tuple(metric_names(load_scenario("circle")))


def limits(chance: random.Random) -> str:
    """Conditions of a limit: refused in words, or met or not by any metrics."""
    warnings.simplefilter("error")
    for _ in range(20):
        text = "".join(chance.choice(WORDS) + chance.choice(SIGNS) for _ in range(chance.randint(1, 6)))
        text = chance.choice([text, "(" * chance.randrange(3000) + text, text * 50])
        try:
            condition = Condition(text, names())
        except ScenarioError as error:
            if not 0 < len(str(error)) < LONGEST_TEXT:
                return f"a message of {len(str(error))} characters for {text[:200]!r}"
            continue
        for number in (nan, inf, None, -0.0, 1e308):
            condition.met(dict.fromkeys(names(), number) | {"outcome": "stuck"})
    return ""


def extremes(chance: random.Random) -> str:
    """Numbers far off, on MuJoCo: refused with a limit, or run to an honest end."""
    chosen = chance.sample(numbers(), chance.randint(1, 3))
    factors = [chance.choice([1e-9, 1e-3, 0.1, 0.5, 2.0, 10.0, 1e3, 1e9, -1.0]) for _ in chosen]
    texts = [f"{key}={value * factor!r}" for (key, value), factor in zip(chosen, factors, strict=True)]
    kind = chance.choice(["linear", "magic_formula", "soil", "contact", "ruts"])
    path = chance.choice(["circle", "side_slope_5", "figure_eight"])
    short = sets("duration_s=0.5", "plant.settle_s=0.2", "plant.settle_limit_s=2", f"plant.tyre.kind={kind}", *texts)
    return call(["run", path, "--no-rrd", "--quiet", "--out", "out", *short])
