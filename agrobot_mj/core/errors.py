"""Bad input, told to a person. Imports nothing heavy: the command line needs it before anything else."""

from collections.abc import Sequence
from difflib import get_close_matches


class ScenarioError(ValueError):
    """Input that cannot be run; its text is the whole message for the user."""


class CommandError(ValueError):
    """A command from outside that cannot be carried out."""


class NotFiniteError(ArithmeticError):
    """A message of a stage that is not finite; its text names field and stage."""


def suggestion(word: str, known: Sequence[str]) -> str:
    """`; did you mean 'x'?` or nothing."""
    close = get_close_matches(word, known, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""
