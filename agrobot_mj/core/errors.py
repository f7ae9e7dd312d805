"""Errors with the text that a user reads. Imports nothing heavy: the command line needs it before anything else."""

from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Any

LONGEST_LINE, LONGEST_VALUE = 2000, 120
"""Characters of a line of a message, and of a value or key that it repeats."""


def shortened(text: str, most: int = LONGEST_VALUE) -> str:
    """A text of at most about `most` characters: of a longer one its two ends."""
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 4 :]} ({len(text)} characters)"


def shortened_lines(text: str) -> str:
    """A text with lines of at most about `LONGEST_LINE` characters."""
    return "\n".join(shortened(line, LONGEST_LINE) for line in text.split("\n"))


class ScenarioError(ValueError):
    """Input that cannot be run; its text is the whole message for the user."""

    def __init__(self, text: str = "") -> None:
        super().__init__(shortened_lines(str(text)))


class CommandError(ValueError):
    """A command from outside that cannot be carried out."""


class NotFiniteError(ArithmeticError):
    """A message of a stage that is not finite, or absurd; its text names field and stage."""


def suggestion(word: str, known: Sequence[str]) -> str:
    """`; did you mean 'x'?` or nothing."""
    close = get_close_matches(word, known, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""


def required(module: str, extra: str, purpose: str) -> Any:
    """The module. Raises `ScenarioError` with the command that installs the extra where it is missing."""
    try:
        return import_module(module)
    except ImportError as error:
        missing = f" ({error})" if not isinstance(error, ModuleNotFoundError) else ""
        package = module.partition(".")[0]
        raise ScenarioError(f'{purpose} needs {package}{missing}; pip install "agrobot-mj[{extra}]"') from None
