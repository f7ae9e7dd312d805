"""MkDocs hooks that generate pages from the code and resolve links to files outside docs/.

CHANGELOG.md, CONTRIBUTING.md and the notebooks become pages; other linked files are copied to the site. Pages of
removed extensions are omitted from the menu and the links.
"""

import json
import re
import sys
from pathlib import Path
from posixpath import dirname, join, normpath, relpath
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

import docs_pages  # noqa: E402

MADE = {"keys.md": docs_pages.keys_page, "commands.md": docs_pages.commands_page, "api.md": docs_pages.api_page}
"""Functions that return the generated pages, by file name in the site."""
BROUGHT = {
    **{"changelog.md": "CHANGELOG.md", "contributing.md": "CONTRIBUTING.md"},
    **{"first_drive.md": "examples/notebooks/first_drive.ipynb", "own_law.md": "examples/notebooks/own_law.ipynb"},
    **{"log_to_twin.md": "examples/notebooks/log_to_twin.ipynb"},
    **{"boundary_to_report.md": "examples/notebooks/boundary_to_report.ipynb"},
}
"""Source files outside docs/ that become pages, by file name in the site."""
LINK = re.compile(r"(\]\()([^)\s:#]+)(#[^)]*)?\)")
WHOLE = re.compile(r"!?\[([^\]]*)\]\(([^)\s:#]+)(?:#[^)]*)?\)")
"""Patterns of Markdown links: the target part of a link, and a complete link with its text."""
CELL, LONG = re.compile(r"<td.*?</td>", re.DOTALL), re.compile(r"<code>([^<\s]{25,})</code>")
"""Patterns of a table cell in HTML, and of a name in a cell that is too long for one line."""
FENCE = re.compile(r"(^```.*?^```$)", re.DOTALL | re.MULTILINE)


def on_config(config: Any) -> Any:
    """Remove the pages of missing extensions from the navigation menu."""
    for part in config.nav:
        for name, pages in part.items():
            if isinstance(pages, list):
                part[name] = [page for page in pages if not absent(f"docs/{next(iter(page.values()))}")]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add generated pages, pages with sources outside docs/, and other linked files to the site."""
    for name, page in MADE.items():
        files.append(File.generated(config, name, content=page()))
    for name, source in BROUGHT.items():
        files.append(File.generated(config, name, content=moved(source)))
    pages = files.documentation_pages()
    for target in sorted({target for file in pages for target in outside(file.content_string, file.src_uri)}):
        files.append(File.generated(config, f"checkout/{target}.txt", abs_src_path=str(ROOT / target)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Replace links to files outside docs/ by links to the copies of these files in the site."""
    return relinked(markdown, page.file.src_uri)


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Allow line breaks after dots and underscores in long names in table cells."""
    return CELL.sub(lambda cell: LONG.sub(_breaking, cell[0]), html)


def _breaking(code: re.Match[str]) -> str:
    text = code[1].replace(".", ".<wbr>").replace("_", "_<wbr>")
    return f'<code class="long">{text}</code>'


def moved(source: str) -> str:
    """Return a Markdown file or notebook of the checkout as Markdown, with links relative to docs/."""

    def link(found: re.Match[str]) -> str:
        return f"{found[1]}{relpath(normpath(join(dirname(source), found[2])), 'docs')}{found[3] or ''})"

    text = (ROOT / source).read_text(encoding="utf-8")
    return outside_code(LINK, link, notebook(text) if source.endswith(".ipynb") else text)


def notebook(text: str) -> str:
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(text)["cells"]]
    return "\n\n".join(f"```python\n{source}\n```" if kind == "code" else source for kind, source in cells)


def relinked(text: str, page: str) -> str:
    """Return the text of a page with links to files outside docs/ replaced by links into the site."""
    pages = {source: name for name, source in BROUGHT.items()}

    def link(found: re.Match[str]) -> str:
        target = target_of(found[2], page)
        if target.startswith("docs/"):
            return found[0]
        place = relpath(pages.get(target) or f"checkout/{target}.txt", dirname(page) or ".")
        return f"{found[1]}{place}{found[3] or ''})"

    def plain(found: re.Match[str]) -> str:
        return found[1] if absent(target_of(found[2], page)) else found[0]

    return outside_code(WHOLE, plain, outside_code(LINK, link, text))


def outside(text: str, page: str) -> set[str]:
    """Return the files outside docs/ to which a page links, except files that become pages."""
    targets = {target_of(found[2], page) for part in FENCE.split(text)[::2] for found in LINK.finditer(part)}
    return {target for target in targets if not target.startswith("docs/") and target not in BROUGHT.values()}


def target_of(link: str, page: str) -> str:
    """Return the path of a linked file relative to the checkout. The path `page` is relative to docs/."""
    return normpath(join("docs", dirname(page), link))


def absent(path: str) -> bool:
    parts = Path(path).parts
    return parts[:2] == ("docs", "extensions") and not (ROOT / "agrobot_mj" / Path(*parts[1:3])).is_dir()


def outside_code(pattern: re.Pattern[str], replace: Any, text: str) -> str:
    """Return the text after replacing a pattern everywhere except in fenced code blocks."""
    parts = FENCE.split(text)
    return "".join(part if k % 2 else pattern.sub(replace, part) for k, part in enumerate(parts))
