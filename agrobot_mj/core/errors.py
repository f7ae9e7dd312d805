"""Errors with the text that a user reads. Imports nothing heavy: the command line needs it before anything else."""

from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Any

LONGEST_LINE, LONGEST_VALUE = 2000, 120
"""Characters of a line of a message, and of a value or key that it repeats."""
MOST_FAULTS, MOST_LINES, LONGEST_TEXT = 20, 120, 20_000
"""Faults of one file that a message lists; lines and characters of a message."""

LIKENESS = 0.6
"""Likeness of two words that may be meant for each other [-]. Assumed value."""


def shortened(text: str, most: int = LONGEST_VALUE) -> str:
    """A text of at most about `most` characters: of a longer one its two ends."""
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 4 :]} ({len(text)} characters)"


def bounded(text: str) -> str:
    """A message of at most about `MOST_LINES` lines and `LONGEST_TEXT` characters, and the number of lines left out."""
    lines, end = text.split("\n"), " more lines"
    shown = [shortened(line, LONGEST_LINE) for line in lines[: MOST_LINES + 1]]
    length = len("\n".join(shown))
    if len(lines) <= MOST_LINES + text.endswith(end) and length <= LONGEST_TEXT:
        return "\n".join(shown)
    while len(shown) > MOST_LINES or length > LONGEST_TEXT - LONGEST_VALUE:
        length -= len(shown.pop()) + 1
    return "\n".join([*shown, f"and {len(lines) - len(shown):,}{end}"])


class ScenarioError(ValueError):
    """Input that cannot be run; its text is the whole message for the user."""

    def __init__(self, text: str = "") -> None:
        super().__init__(bounded(str(text)))


class CommandError(ValueError):
    """A command from outside that cannot be carried out."""


class NotFiniteError(ArithmeticError):
    """A message of a stage that is not finite, or absurd; its text names field and stage."""


def suggestion(word: str, known: Sequence[str]) -> str:
    """`; did you mean 'x'?` or nothing; the case of letters counts for nothing."""
    by_lower = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), by_lower, n=1, cutoff=LIKENESS)
    return f"; did you mean {by_lower[close[0]]!r}?" if close else ""


def required(module: str, extra: str, purpose: str) -> Any:
    """The module. Raises `ScenarioError` with the command that installs the extra where it is missing."""
    try:
        return import_module(module)
    except ImportError as error:
        missing = f" ({error})" if not isinstance(error, ModuleNotFoundError) else ""
        package = module.partition(".")[0]
        raise ScenarioError(f'{purpose} needs {package}{missing}; pip install "agrobot-mj[{extra}]"') from None
