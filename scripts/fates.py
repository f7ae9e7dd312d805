"""What becomes of a mutant, and what that says: a test that fails in earnest, or a name that is not there."""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import pytest
from mutants import Mutant

from agrobot_mj.core.markdown import markdown_table

TIME, UNDECIDED = "SIGXCPU", ("status", "SIGALRM", "SIGKILL")
"""Signal where the CPU time is up, and ends that tell nothing of the mutant."""


class Fate(NamedTuple):
    """What became of a mutant."""

    killed: str
    """The first test that fails, "import", or the signal or status that ended the tests; "" where all pass."""
    how: str = ""
    """Class of the exception: AssertionError where a test does not find what it expects."""
    absent: tuple[str, ...] = ()
    """Names that do not exist, of the exception and of those that led to it."""


def exceptions(error: BaseException | None) -> Iterator[BaseException]:
    """An exception, those of its group, and those that led to it."""
    seen: set[int] = set()
    queue = [error]
    while queue:
        one = queue.pop()
        if one is not None and id(one) not in seen:
            seen.add(id(one))
            yield one
            queue += [one.__cause__, one.__context__, *getattr(one, "exceptions", ())]


def fate_of(test: str, error: BaseException) -> Fate:
    """Fate of a mutant with which a test ends in this exception; "import" where it cannot be imported."""
    missing = [one for one in exceptions(error) if isinstance(one, NameError | AttributeError)]
    absent = {name for one in missing for name in (one.name, *re.findall(r"'(\w+)'", str(one))) if name}
    how = "AssertionError" if isinstance(error, AssertionError | pytest.fail.Exception) else type(error).__name__
    return Fate(test, how, tuple(sorted(absent)))


def brings_in_an_absent_name(mutant: Mutant, fate: Fate) -> bool:
    """Whether it failed for a name that does not exist and that the unchanged source does not have in this place."""
    words = set(re.findall(r"\w+", mutant.text)) - set(re.findall(r"\w+", mutant.before))
    return not words.isdisjoint(fate.absent)


def table(rows: list[dict[str, Any]]) -> str:
    """Mutants by group and how they were killed, and the survivors, as Markdown; those that do not count left out."""
    rows = [row for row in rows if not row["absent"]]
    lines = []
    groups = [*dict.fromkeys((row["group"], row["seed"]) for row in rows), ("together", "")]
    for name, seed in groups:
        some = [row for row in rows if name == "together" or (row["group"], row["seed"]) == (name, seed)]
        dead = [row["how"] for row in some if row["killed"]]
        asserted, late = dead.count("AssertionError"), dead.count(TIME)
        counts = (len(some), len(dead), asserted, len(dead) - asserted - late, late)
        lines.append((name, seed, *counts))
    heads = ("group", "seed", "mutants", "killed", "by an assertion", "by an error", "by time")
    survivors = [
        (f"{row['module']}:{row['line']}", f"`{row['before']}` becomes `{row['text']}`".replace("\n", " "))
        for row in rows
        if not row["killed"]
    ]
    return f"{markdown_table(heads, lines)}\n\n{markdown_table(('survivor', 'change'), survivors)}"
