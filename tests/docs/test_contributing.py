"""CONTRIBUTING.md names existing Makefile targets, and exactly the folders of the repository."""

import re
import subprocess
from pathlib import Path

import pytest
from removed import REMOVED_PAGES

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def first_cells(pattern):
    """Return the matches of the pattern in the first cells of the tables, in order."""
    return re.findall(rf"^\| `{pattern}` \|", TEXT, re.MULTILINE)


def tracked_folders():
    """Return the top-level folders that git tracks, except hidden ones."""
    if not (ROOT / ".git").exists():
        pytest.skip("this is no checkout")
    files = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    return {file.partition("/")[0] for file in files if "/" in file and not file.startswith(".")}


def test_makefile_targets_named_on_the_page_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    verbs = re.findall(r"^([a-z-]+):.*##", makefile, re.MULTILINE)
    (phony,) = re.findall(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert sorted(verbs) == sorted(phony.split())
    named = set(re.findall(r"`make ([a-z-]+)", TEXT))
    assert {"help", "install", "check", "test", "reference"} <= named
    assert named <= set(verbs)


def test_repository_folders_are_listed_on_the_page():
    assert sorted(first_cells(r"([a-z_]+)/")) == sorted(tracked_folders())


def test_package_folders_are_listed_on_the_page_in_import_order():
    package = ROOT / "agrobot_mj"
    listed = first_cells(r"agrobot_mj/([a-z_]+)/")
    assert sorted(listed) == sorted(file.parent.name for file in package.glob("*/__init__.py"))
    for position, folder in enumerate(listed):
        for file in (package / folder).rglob("*.py"):
            used = set(re.findall(r"^\s*from agrobot_mj\.(\w+)", file.read_text(encoding="utf-8"), re.MULTILINE))
            assert used <= set(listed[: position + 1]), file


def test_files_and_link_targets_named_on_the_page_exist():
    links = re.findall(r"\]\(([^)#:]+)\)", TEXT)
    paths = re.findall(r"`((?:agrobot_mj|docs|models|scripts|tests|\.ci)/[\w./]*)`", TEXT)
    assert links
    assert paths
    missing = [path for path in (*links, *paths) if not (ROOT / path).exists()]
    assert [path for path in missing if not path.startswith(REMOVED_PAGES)] == []
