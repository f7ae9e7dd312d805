"""Invalid conditions for searches."""

import random
import warnings
from functools import cache
from math import inf, nan

from judge import LONGEST_TEXT

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.search.limit.condition import Condition
from agrobot_mj.extensions.search.limit.question import metric_names

WORDS = ("lateral_rms", "outcome", "xte_rms", "nope", "per_turn", "__class__", "wall_s", "completed", "1e999", "nan")
WORDS += ("None", "'x'", "().__class__", "[1]", "lambda: 0", "-0.3", "0.3", "9" * 400, "é", "\x00", "outcome.x")
SIGNS = ("<", ">", "==", "!=", " and ", " or ", "+", "**", "not ", "(", ")", ",", " in ", " if ", ":=", "", " ", "\n")


@cache
def names() -> tuple[str, ...]:
    """Return the names of the metrics of a run, which conditions may contain."""
    return tuple(metric_names(load_scenario("circle")))


def limits(chance: random.Random) -> str:
    """Parse random conditions of a limit search. The conditions must be rejected with a message or be valid for any
    metrics."""
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
            condition.is_met(dict.fromkeys(names(), number) | {"outcome": "stuck"})
    return ""


CLASSES = {"limits": (limits, 0.05, names)}
