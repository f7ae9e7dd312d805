"""Word limits of the documentation, without text written by scripts.

The changelog is not counted. paper.md is written for journal readers and has a separate limit.
"""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
BOUND = 30_850  # Two and a half hours of reading
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
WRITTEN = re.compile(r"This page is written by `|`agrobot-mj validate`\s+runs\s+all\s+manoeuvres,\s+writes\s+this")
"""Notice on a page that a script writes the complete page."""
READING_PATH = (
    *("README.md", "docs/tutorial.md", "docs/cookbook.md", "docs/scenarios.md", "docs/machines.md", "docs/guidance.md"),
    *("docs/studies.md", "docs/recordings.md", "docs/extending.md", "docs/findings.md"),
    *("docs/extensions/links/link.md", "docs/extensions/logs/replay.md"),
)
"""Pages that a user reads in order, if their extensions are present."""
PATH_BOUND = 14_500  # Words of these pages, tables, generated blocks and code included
BLOCK = re.compile(r"^<!-- (.+?) -->\n.*?^<!-- end of \1 -->$", re.MULTILINE | re.DOTALL)


def all_words(text: str) -> int:
    """Return the number of words, without table rules and other symbols."""
    return sum(any(map(str.isalnum, word)) for word in text.split())


def words(text: str) -> int:
    """Return the number of words outside the blocks that scripts write."""
    return all_words(BLOCK.sub("", text))


def to_read() -> dict[str, int]:
    """Return the number of words by page, without pages that are completely written by a script."""
    texts = {page.name: page.read_text(encoding="utf-8") for page in PAGES}
    return {name: words(text) for name, text in texts.items() if not WRITTEN.search(text)}


def test_words_in_generated_blocks_are_not_counted():
    text = "Two words\n<!-- a b -->\n| not | these |\n<!-- end of a b -->\n| --- | and `three` more |\n<!-- open -->"
    assert words(text) == 6
    assert all_words(text) == 14
    assert {"columns.md", "validation.md"}.isdisjoint(to_read())


def test_pages_stay_within_their_word_limits():
    found = to_read()
    assert sum(found.values()) <= BOUND, sorted(found.items(), key=lambda item: -item[1])


def test_recommended_reading_path_is_within_its_word_limit():
    """Tables are also counted; long tables belong in docs/reference."""
    texts = {name: (ROOT / name).read_text(encoding="utf-8") for name in READING_PATH if (ROOT / name).exists()}
    assert set(READING_PATH) - set(texts) <= {name for name in READING_PATH if "extensions" in name}
    found = {name: all_words(text) for name, text in texts.items()}
    assert sum(found.values()) <= PATH_BOUND, sorted(found.items(), key=lambda item: -item[1])
