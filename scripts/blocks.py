"""Blocks of documentation pages that scripts replace, between `<!-- NAME -->` and `<!-- end of NAME -->`."""

import re
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"


def page(name: str, docs: Path = DOCS) -> Path:
    """Return the path of the page `name`.md, which is in the folder `docs` or in a subfolder."""
    (found,) = docs.rglob(f"{name}.md")
    return found


def block(text: str, name: str) -> str:
    return _found(text, name).group(1)


def put(text: str, name: str, content: str) -> str:
    """Return the text of a page after replacing the content of the block `name`."""
    found = _found(text, name)
    return text[: found.start(1)] + content + text[found.end(1) :]


def _found(text: str, name: str) -> re.Match[str]:
    begin, end = re.escape(f"<!-- {name} -->\n"), re.escape(f"\n<!-- end of {name} -->")
    found = re.compile(f"{begin}(.*?){end}", re.DOTALL).search(text)
    if not found:
        raise SystemExit(f"the page has no block <!-- {name} -->; restore it")
    return found
