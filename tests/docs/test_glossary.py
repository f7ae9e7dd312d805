"""docs/glossary.md explains each abbreviation of the pages on one line, in alphabetical order."""

import re
from collections import Counter
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
ROWS = re.findall(r"^\| (.+?) \| (.+?) \|$", (DOCS / "glossary.md").read_text(encoding="utf-8"), re.M)[1:]
PAGES = [page for page in sorted(DOCS.rglob("*.md")) if page.stem != "glossary"]
COMMON = {"ASABE", "GB", "ISO", "JSON", "MB", "ROS", "SI", "SIGTERM", "TOML", "UDP"}
"""Common abbreviations that the glossary omits."""


def abbreviations(text):
    """Return the words in capitals outside code and links."""
    prose = re.sub(r"```.*?```|`[^`\n]*`|\]\([^)\s]*\)", " ", text, flags=re.S)
    return set(re.findall(r"\b[A-Z]+[0-9]?[A-Z]+\b", prose))


def test_abbreviations_used_on_several_pages_are_explained():
    pages = Counter(word for page in PAGES for word in abbreviations(page.read_text(encoding="utf-8")))
    explained = {word for term, meaning in ROWS for word in abbreviations(f"{term} {meaning}")}
    assert {word for word, number in pages.items() if number > 1} - explained - COMMON == set()


def test_glossary_terms_are_sorted_and_short():
    terms = [term.replace("`", "").lower() for term, _ in ROWS]
    assert len(terms) > 40
    assert terms == sorted(set(terms))
    assert max(len(meaning.split()) for _, meaning in ROWS) <= 15
