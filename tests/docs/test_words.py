"""The documentation stays short: words that its users have to read, apart from what scripts write.

Not counted: the changelog, and paper.md, which is written for readers of a journal and has a bound of its own.
"""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
BOUND = 34_000
"""Two hours and fifty minutes of reading."""
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
WRITTEN = re.compile(r"This page is written by `|`agrobot-mj validate` drives them, writes this\s+page")
"""What a page says that a script writes as a whole."""
BLOCK = re.compile(r"^<!-- (.+?) -->\n.*?^<!-- end of \1 -->$", re.MULTILINE | re.DOTALL)


def words(text: str) -> int:
    """Number of words outside the blocks that scripts write; rules of tables and other signs are none."""
    return sum(any(map(str.isalnum, word)) for word in BLOCK.sub("", text).split())


def to_read() -> dict[str, int]:
    """Words by page, without those that a script writes as a whole."""
    texts = {page.name: page.read_text(encoding="utf-8") for page in PAGES}
    return {name: words(text) for name, text in texts.items() if not WRITTEN.search(text)}


def test_words_are_counted_outside_generated_blocks():
    text = "Two words\n<!-- a b -->\n| not | these |\n<!-- end of a b -->\n| --- | and `three` more |\n<!-- open -->"
    assert words(text) == 6
    assert {"columns.md", "validation.md"}.isdisjoint(to_read())


def test_the_pages_stay_within_the_word_limit():
    found = to_read()
    assert sum(found.values()) <= BOUND, sorted(found.items(), key=lambda item: -item[1])
