"""Printing of command results on stdout and hints on stderr. A closed pipe or a full disk does not end the command."""

import sys
from collections.abc import Iterable
from itertools import islice
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from agrobot_mj.scenario.schema import Scenario

MOST_SCENARIOS, MOST_LINES = 100, 10
"""Maximum number of scenarios that are checked for hints, and maximum number of hints that are printed."""


def print_hints(scenarios: "Iterable[Scenario]", quiet: bool) -> list[str]:
    """Print hints about the first scenarios to stderr without duplicates, and return them. If `quiet`, return []."""
    if quiet:
        return []
    from agrobot_mj.scenario.hints import hints

    some = islice(scenarios, MOST_SCENARIOS)
    lines = list(dict.fromkeys(f"{scenario.name}: {line}" for scenario in some for line in hints(scenario)))
    for line in lines[:MOST_LINES]:
        print(line, file=sys.stderr)
    if len(lines) > MOST_LINES:
        print(f"and {len(lines) - MOST_LINES} more hints", file=sys.stderr)
    return lines


def say(text: object) -> None:
    """Print a result to stdout. Report write errors on stderr, except for a closed pipe."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        pass
    except OSError as error:
        print(f"stdout: cannot be written: {error.strerror}", file=sys.stderr)
