"""Documents that commands print with `--json`, and what the page says of them."""

import re
from pathlib import Path

PAGE = (Path(__file__).parents[1] / "docs" / "index.md").read_text(encoding="utf-8")
COMMON = {"command", "version", "exit_status", "error"}


def documented(verb):
    """The keys of a verb's document that the page names outside parentheses, before any colon."""
    cells = re.search(rf"^\| `{verb}` \| (.*) \|$", PAGE, re.MULTILINE)[1]
    named = [part.partition(":")[0] for part in re.sub(r"\(.*?\)", "", cells).split(";")]
    return {name for part in named for name in re.findall(r"`(\w+)`(?!\.)", part)}
