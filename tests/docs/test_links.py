"""Every link and anchor in Markdown files has a target, and the menu of the site contains every page of docs/."""

import re
from pathlib import Path
from posixpath import normpath

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md"))]
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"^(```|~~~).*?^\1\s*$", re.DOTALL | re.MULTILINE)


def prose(page):
    """Return the text of a page without fenced blocks and code spans."""
    return re.sub(r"`[^`\n]*`", "", FENCE.sub("", page.read_text(encoding="utf-8")))


def anchors(page):
    """Return the anchors that GitHub and the site create for the headings of a page."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    found = []
    for heading in re.findall(r"^#{1,6} +(.*?) *$", text, re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
        found.append(slug if slug not in found else f"{slug}-{found.count(slug)}")
    return found


def of_removed_extension(file):
    """Return whether a file would be in the pages of an extension whose folder is absent."""
    parts = Path(normpath(file)).relative_to(ROOT).parts
    return parts[:2] == ("docs", "extensions") and not (ROOT / "agrobot_mj" / Path(*parts[1:3])).is_dir()


def test_only_pages_of_removed_extensions_may_be_absent():
    assert of_removed_extension(DOCS / "reference" / ".." / "extensions" / "no_such_extension" / "page.md")
    assert not of_removed_extension(DOCS / "no_such_page.md")
    for folder in (ROOT / "agrobot_mj" / "extensions").glob("*/"):
        assert not of_removed_extension(DOCS / "extensions" / folder.name / "no_such_page.md")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_link_targets_and_anchors_exist(page):
    broken = []
    for target in LINK.findall(prose(page)):
        if target.startswith(("http://", "https://", "mailto:")):
            continue
        path, _, anchor = target.partition("#")
        file = page.parent / path if path else page
        if of_removed_extension(file):
            continue
        if not file.exists() or (anchor and (file.suffix != ".md" or anchor not in anchors(file))):
            broken.append(target)
    assert broken == []


def test_relative_links_point_to_files_inside_the_repository():
    for page in PAGES:
        for target in LINK.findall(prose(page)):
            path = target.partition("#")[0]
            if path and "://" not in path:
                inside = normpath((page.parent.relative_to(ROOT) / path).as_posix())
                assert not inside.startswith(".."), f"{page.name}: {target}"
                file = ROOT / inside
                assert file.is_file() or of_removed_extension(file), f"{page.name}: {target} is no file"


def test_every_page_is_in_the_site_menu_exactly_once():
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    named = re.findall(r"^ +- [^:]+: (\S+\.md)$", menu, re.MULTILINE)
    hooks = (ROOT / "scripts" / "docs_site.py").read_text(encoding="utf-8")
    assert len(named) == len(set(named))
    assert {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")} <= set(named)
    for name in named:
        assert (DOCS / name).is_file() or of_removed_extension(DOCS / name) or f'"{name}"' in hooks, name


@pytest.mark.parametrize("start", ["README.md", "docs/index.md"])
def test_every_page_is_within_two_clicks_of_the_first_page(start):
    def linked(page):
        return {(page.parent / target.partition("#")[0]).resolve() for target in LINK.findall(prose(page))}

    first = linked(ROOT / start)
    second = {page for each in first if each.suffix == ".md" and each.is_file() for page in linked(each)}
    assert set(DOCS.rglob("*.md")) <= first | second | {ROOT / start}


def test_every_image_file_of_the_docs_is_shown_on_a_page():
    shown = {normpath((page.parent / target).as_posix()) for page in PAGES for target in LINK.findall(prose(page))}
    pictures = [file for file in DOCS.rglob("*.*") if file.suffix in (".gif", ".jpg", ".png", ".svg")]
    assert pictures
    assert [str(file.relative_to(ROOT)) for file in pictures if normpath(file.as_posix()) not in shown] == []
