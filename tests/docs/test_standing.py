"""Pages of results state version and commit that they were made with: today's version, unless they are out of date."""

import re
import subprocess
from pathlib import Path

import pytest
from blocks import block

from agrobot_mj.core.version import __version__

ROOT = Path(__file__).parents[2]
PAGES = {page.stem: page.read_text("utf-8") for page in sorted((ROOT / "docs").glob("*.md"))}
STANDING = [
    (page, name)
    for page, text in PAGES.items()
    for name in re.findall(r"^<!-- (standing(?: \w+)?) -->\n(?!Not driven yet;)", text, re.M)
]
OUT_OF_DATE = "> **Out of date"


def show(commit, path):
    """A file as of a commit; skips where the history is not there."""
    found = subprocess.run(("git", "show", f"{commit}:{path}"), cwd=ROOT, capture_output=True, text=True, check=False)
    if found.returncode:
        pytest.skip(f"this is no checkout with the commit {commit}")
    return found.stdout


def test_pages_of_results_state_version_and_commit():
    assert {page for page, _ in STANDING} >= {"findings", "findings_tables", "estimators", "safety"}


@pytest.mark.parametrize(("page", "name"), STANDING)
def test_states_todays_version_unless_marked_outdated(page, name):
    version = re.match(r"Version ([\d.]+)[,;]", block(PAGES[page], name))[1]
    assert OUT_OF_DATE in PAGES[page] or version == __version__, f"make the page again, or begin it with {OUT_OF_DATE}"


@pytest.mark.parametrize(("page", "name"), [each for each in STANDING if each[0] != "safety"])
def test_states_a_commit_of_that_version(page, name):
    version, commit = re.match(r"Version ([\d.]+), commit ([0-9a-f]{9})[.;]", block(PAGES[page], name)).groups()
    assert f'__version__ = "{version}"' in show(commit, "agrobot_mj/core/version.py")
