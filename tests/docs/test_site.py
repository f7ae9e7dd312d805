"""Documentation site: reference pages are complete, and the build needs no network and reports no errors."""

import os
import re
import subprocess
import sys
from pathlib import Path

import docs_pages
import pytest
import typer.main

from agrobot_mj.cli import app
from agrobot_mj.cli.app import COMMANDS
from agrobot_mj.core.spec import members
from agrobot_mj.scenario.reference import families
from agrobot_mj.scenario.schema import Scenario

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def keys_below(owner, above):
    """Return the names of all keys that have a value, in any table."""
    found = set()
    for name, field in owner.model_fields.items():
        parts = members(field.annotation)
        found |= {name} if not parts and name != "kind" else set()
        for part in parts.values():
            found |= keys_below(part, (*above, part)) if part not in above else set()
    return found


def test_every_key_and_every_kind_is_in_the_reference():
    text = docs_pages.keys_page()
    assert set(re.findall(r"^\| `(\w+)` \|", text, re.M)) == keys_below(Scenario, ())
    headings = re.findall(r"^## (.*)$", text, re.M)
    for table, kinds in families().items():
        of_table = [line for line in headings if line.startswith(f"`[{table}]`")]
        for kind in kinds:
            assert any(f'`kind = "{kind}"`' in line for line in of_table), (table, kind)
    assert len(headings) == len(set(headings))
    assert "| `wheelbase_m` | `1.4` | number, above 0" in text


def test_every_table_row_has_as_many_cells_as_its_header():
    for text in (docs_pages.keys_page(), docs_pages.commands_page()):
        for block in re.findall(r"(?:^\|.*\n?)+", text, re.M):
            counts = {len(re.findall(r"(?<!\\)\|", line)) for line in block.splitlines()}
            assert len(counts) == 1, block[:200]


def test_every_command_and_option_is_in_the_reference():
    text = docs_pages.commands_page()
    for name, command in typer.main.get_command(app).commands.items():
        section = text.partition(f"\n## `{name}`\n")[2].partition("\n## ")[0]
        assert f"agrobot-mj {name}" in section
        for parameter in command.params:
            shown = parameter.param_type_name == "option" and not parameter.hidden
            for option in parameter.opts if shown else []:
                assert option in section, (name, option)
        assert all(f"agrobot-mj {example}\n" in section for example in COMMANDS[name].examples)


def test_the_public_python_names_are_in_the_reference():
    import agrobot_mj

    text = docs_pages.api_page()
    for name in set(agrobot_mj.__all__) - {"__version__"}:
        assert re.search(rf"^::: agrobot_mj\.[\w.]+\.{name}$", text, re.M), name
    for path in re.findall(r"^::: (\S+)$", text, re.M):
        file = ROOT / Path(*path.split(".")).with_suffix(".py")
        owner = ROOT / Path(*path.split(".")[:-1]).with_suffix(".py")
        assert file.is_file() or owner.is_file(), path


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the folder of the documentation site, which is built as `make docs` does."""
    pytest.importorskip("mkdocs", reason="needs the builder of the documentation; `make docs` installs it")
    folder = tmp_path_factory.mktemp("site")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path]), "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def test_site_has_all_pages_and_loads_no_files_from_other_hosts(site):
    pages = {page.relative_to(DOCS).with_suffix(".html") for page in DOCS.rglob("*.md")}
    assert pages <= {page.relative_to(site) for page in site.rglob("*.html")}
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"<(?:script|img|iframe)[^>]*src=\"(?:https?:)?//", text), page
        assert not re.search(r"<link[^>]*rel=\"(?:stylesheet|preconnect)\"[^>]*href=\"(?:https?:)?//", text), page


def test_lists_and_tables_are_rendered_on_the_site(site):
    for page in DOCS.rglob("*.md"):
        text = (site / page.relative_to(DOCS).with_suffix(".html")).read_text(encoding="utf-8")
        for paragraph in re.findall(r"<p>(.*?)</p>", text, re.S):
            assert not re.search(r"\n(?:- |\d\. |\|[ -])", paragraph), (page.name, paragraph[:100])


def test_only_long_code_in_a_table_cell_is_wrapped(site):
    text = (site / "equations.html").read_text(encoding="utf-8")
    assert '<td><code class="long">control.<wbr>t2fnn_<wbr>laws.<wbr>normalised</code></td>' in text
    assert "<td><code>tri1i_alt</code></td>" in text


def test_python_reference_shows_signatures_and_docstrings(site):
    text = re.sub(r"<[^>]+>", "", (site / "api.html").read_text(encoding="utf-8"))
    assert "Load a scenario by name or path" in text
    assert "Base of all guidance laws" in text
