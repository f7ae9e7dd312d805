"""Exceptions, and formatting of their messages.

This module imports no large library, because the command line imports it first.
"""

from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from importlib.util import find_spec
from typing import Any

LONGEST_LINE, LONGEST_VALUE = 2000, 120
"""Maximum length of a line in a message, and of a quoted value or key [characters]."""
MOST_FAULTS, MOST_LINES, LONGEST_TEXT = 20, 120, 20_000
"""Maximum number of errors listed per file, and maximum number of lines and of characters of a message."""

PLUGIN = "a plugin's kind needs --plugin FILE.py and @register"  # End of the messages about unknown kinds
LIKENESS = 0.6  # Minimum similarity of a word suggested in place of an unknown word [-]. Assumed value.


def shorten(text: str, most: int = LONGEST_VALUE) -> str:
    """Return `text`. Beyond `most` characters, an ellipsis replaces the middle, and the length is appended."""
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 4 :]} ({len(text)} characters)"


def shorten_lines(text: str) -> str:
    """Return a message shortened to about `MOST_LINES` lines and `LONGEST_TEXT` characters.

    If lines are omitted, the last line states their number.
    """
    lines, end = text.split("\n"), " more lines"
    shown = [shorten(line, LONGEST_LINE) for line in lines[: MOST_LINES + 1]]
    length = len("\n".join(shown))
    if len(lines) <= MOST_LINES + text.endswith(end) and length <= LONGEST_TEXT:
        return "\n".join(shown)
    while len(shown) > MOST_LINES or length > LONGEST_TEXT - LONGEST_VALUE:
        length -= len(shown.pop()) + 1
    return "\n".join([*shown, f"and {len(lines) - len(shown):,}{end}"])


class ScenarioError(ValueError):
    """Error for invalid user input, such as a scenario or a file; its text is the complete message for the user."""

    def __init__(self, text: str = "") -> None:
        super().__init__(shorten_lines(str(text)))


class CommandError(ValueError):
    """Error for a command during an interactive drive that cannot be carried out."""


class NotFiniteError(ArithmeticError):
    """Error for a non-finite or implausible value in the output of a simulation stage; its text names the stage."""


def suggestion(word: str, known: Sequence[str]) -> str:
    """Return `; did you mean 'x'?` with the name in `known` most similar to `word`, ignoring case; "" if none is
    similar."""
    by_lower = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), by_lower, n=1, cutoff=LIKENESS)
    return f"; did you mean {by_lower[close[0]]!r}?" if close else ""


EXTRAS = {
    "rerun": ("recording", "a recording"),
    "contourpy": ("recording", "a recording"),
    "matplotlib": ("report", "a figure"),
    "filterpy": ("filters", "this estimator"),
    "shapely": ("fields", "field work"),
}
"""Optional libraries imported at the top of modules, each with its pip extra and its purpose."""


def is_installed(module: str) -> bool:
    """Return whether the library `module` is installed; the library is not imported."""
    return find_spec(module) is not None


def missing_extra(error: ModuleNotFoundError) -> str:
    """Return the pip command for the missing optional library that `error` reports, or "" for any other module."""
    package = (error.name or "").partition(".")[0]
    if package not in EXTRAS:
        return ""
    extra, purpose = EXTRAS[package]
    return f'{purpose} needs {package}; pip install "agrobot-mj[{extra}]"'


def import_extra(module: str, extra: str, purpose: str) -> Any:
    """Import and return a module. If this fails, raise `ScenarioError` with the command that installs the pip extra."""
    try:
        return import_module(module)
    except ImportError as error:
        missing = f" ({error})" if not isinstance(error, ModuleNotFoundError) else ""
        package = module.partition(".")[0]
        raise ScenarioError(f'{purpose} needs {package}{missing}; pip install "agrobot-mj[{extra}]"') from None
