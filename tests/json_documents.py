"""Documents that commands print with `--json`, and the description of these documents on the page docs/index.md."""

import re
from pathlib import Path

PAGE = (Path(__file__).parents[1] / "docs" / "index.md").read_text(encoding="utf-8")
COMMON = {"command", "version", "exit_status", "error"}


def documented(verb):
    """Return the keys that the page names for the JSON document of a command, outside parentheses and before any
    colon."""
    cells = re.search(rf"^\| `{verb}` \| (.*) \|$", PAGE, re.MULTILINE)[1]
    named = [part.partition(":")[0] for part in re.sub(r"\(.*?\)", "", cells).split(";")]
    return {name for part in named for name in re.findall(r"`(\w+)`(?!\.)", part)}
