"""Pages of measured results state version, commit and code digest, and whether the code has changed since."""

import subprocess
from pathlib import Path

import pytest
from provenance import LATER, STATEMENT, checked, code_of, digest_of, present_code, statements

ROOT = Path(__file__).parents[2]
PAGES = {page.stem: page.read_text("utf-8") for page in sorted((ROOT / "docs").rglob("*.md"))}
STATEMENTS = {(page, name): text for page in PAGES for name, text in statements(PAGES[page]).items()}
AGAIN = "Measured with version 9.8.7, commit 012345678, code {}. To measure again: `make x`.{}"
PAGE = f"<!-- standing x -->\n{AGAIN}\n<!-- end of standing x -->\n"


def test_result_pages_state_the_version_of_their_numbers():
    assert {page for page, _ in STATEMENTS} >= {
        "findings",
        "findings_tables",
        "guidance_tables",
        "estimators_tables",
        "safety",
    }


@pytest.mark.parametrize("page", sorted({page for page, _ in STATEMENTS}))
def test_result_pages_of_older_code_have_an_outdated_notice(page):
    assert checked(PAGES[page]) == PAGES[page], "run `make reference`"


@pytest.mark.parametrize(("page", "name"), STATEMENTS)
def test_code_digest_on_a_page_matches_the_stated_commit(page, name):
    text = STATEMENTS[page, name]
    if "with changes" in text:
        pytest.skip("measured on a checkout with uncommitted changes")
    found = STATEMENT.match(text)
    try:
        assert code_of(found["commit"]) == found["code"]
    except subprocess.CalledProcessError:
        pytest.skip(f"this checkout has no commit {found['commit']}")


def test_outdated_notice_is_on_a_page_only_if_its_code_digest_is_old():
    old, new = "0" * 12, present_code()
    assert checked(PAGE.format(old, "")) == PAGE.format(old, f" {LATER}")
    assert checked(PAGE.format(old, f" {LATER}")) == PAGE.format(old, f" {LATER}")
    assert checked(PAGE.format(new, f" {LATER}")) == PAGE.format(new, "")


def test_result_block_without_a_code_digest_is_rejected():
    with pytest.raises(SystemExit, match="standing x"):
        checked("<!-- standing x -->\nMeasured with version 0.3.0.\n<!-- end of standing x -->\n")


def test_texts_and_raise_statements_do_not_change_the_code_digest():
    bare = b"def f():\n    raise E('a')\n    return 1\n"
    noted = b'"""Head."""\ndef f():\n    """Doc.\n    """\n    # Note.\n    raise E(\n"b")\n    return 1  # Note.\n'
    assert digest_of([("a.py", noted)]) == digest_of([("a.py", bare)])
    assert digest_of([("a.py", bare.replace(b"1", b"2"))]) != digest_of([("a.py", bare)])
    assert digest_of([("a.py", b"def f(x): ...\n")]) != digest_of([("a.py", b"def f(y): ...\n")])
