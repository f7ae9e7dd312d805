"""docs/references.bib contains exactly the sources cited as [Key] in code and documentation or as @Key in paper.md."""

import re
from pathlib import Path

from removed import needs_all

ROOT = Path(__file__).parents[2]
BIBLIOGRAPHY = (ROOT / "docs" / "references.bib").read_text(encoding="utf-8")
CITED = re.compile(r"(?:\[|@)([A-Z][A-Za-z]+\d{4}[a-z]?)\b")
ENTRY = re.compile(r"@(\w+)\{(\w+),\n(.*?)\n\}", re.DOTALL)


def readable() -> list[Path]:
    """Return all files that may contain citations: package, models, scenarios and documentation."""
    found = [ROOT / "README.md", ROOT / "paper.md"]
    for folder, pattern in (
        ("agrobot_mj", "*.py"),
        ("models", "*.xml"),
        ("scenarios", "*.toml"),
        ("docs", "*.md"),
    ):
        found += sorted((ROOT / folder).rglob(pattern))
    return found


def citations() -> dict[str, list[str]]:
    """Return the files that cite a key, by key."""
    found: dict[str, list[str]] = {}
    for path in readable():
        for key in CITED.findall(path.read_text(encoding="utf-8")):
            found.setdefault(key, []).append(str(path.relative_to(ROOT)))
    return found


def keys() -> list[str]:
    return [key for _, key, _ in ENTRY.findall(BIBLIOGRAPHY)]


def test_every_citation_has_a_reference_entry():
    missing = {key: files for key, files in citations().items() if key not in keys()}
    assert not missing


@needs_all
def test_every_reference_is_cited_and_listed_once():
    assert keys() == list(dict.fromkeys(keys()))
    assert not set(keys()) - citations().keys()
    assert len(keys()) == BIBLIOGRAPHY.count("\n@")


def test_every_reference_has_author_title_and_year():
    for _, key, body in ENTRY.findall(BIBLIOGRAPHY):
        for field in ("author", "title", "year"):
            assert re.search(rf"^  {field} *= \{{.+", body, re.MULTILINE), (key, field)
