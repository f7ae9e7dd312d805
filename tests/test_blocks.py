"""Documentation blocks that scripts generate."""

import re
from pathlib import Path

import pytest
from blocks import block, put

DOCS = Path(__file__).parents[1] / "docs"
MARKED = [
    (page.relative_to(DOCS).as_posix(), name)
    for page in sorted(DOCS.rglob("*.md"))
    for name in re.findall(r"<!-- end of (.+?) -->", page.read_text(encoding="utf-8"))
]


@pytest.mark.parametrize(("page", "name"), MARKED)
def test_replacing_a_page_block_by_itself_leaves_the_page_unchanged(page, name):
    text = (DOCS / page).read_text(encoding="utf-8")
    assert put(text, name, block(text, name)) == text
    other = put(text, name, r"other \1 content")
    assert block(other, name) == r"other \1 content"
    assert len(other) - len(text) == len(r"other \1 content") - len(block(text, name))


def test_error_names_the_generated_block_missing_from_a_page():
    with pytest.raises(SystemExit, match="the page has no block <!-- costs -->"):
        put("<!-- costs -->\n1\n", "costs", "2")
