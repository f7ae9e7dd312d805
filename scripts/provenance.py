"""Provenance of measured results on the pages: version, commit, and digest of the code.

A page states the provenance in blocks `<!-- standing -->` or `<!-- standing NAME -->`. The digest ignores comments,
docstrings and `raise` statements, whose messages are often reworded. `make reference` marks blocks that were measured
with other code.
"""

import ast
import io
import re
import subprocess
import tarfile
from collections.abc import Iterable
from functools import cache, partial
from hashlib import sha256
from pathlib import Path

from blocks import put

from agrobot_mj.core.identity import PARTS as DECIDING
from agrobot_mj.core.version import __version__

ROOT = Path(__file__).parent.parent
PARTS = (*(f"agrobot_mj/{part}" for part in DECIDING), "models", "scenarios")
"""Paths of files that affect the results of a run."""
LATER = "The code has changed since."  # Sentence that marks a block as measured with other code
EQUAL = {"f775bb520c53": ("0ae9fd5c16b3", "d066e33c3ef8", "ab172d99e486", "53fb20c024be", "fdb39a9b8fc2")}
"""Digests of earlier code, by the digest of code with bit-identical signals of all library scenarios: only names,
readers of users' files and the computing time changed."""
BLOCK = re.compile(r"^<!-- (?P<name>standing(?: \w+)?) -->\n(?P<text>(?!Not driven yet;).*?)\n<!-- end of", re.M | re.S)
STATEMENT = re.compile(
    r"Measured with version [\d.]+, commit (?P<commit>[0-9a-f]{9})(?: with changes)?, code (?P<code>[0-9a-f]{12})"
)


def statement() -> str:
    """Return a sentence with the version, commit and source hash of the checkout and a note on uncommitted changes."""
    git = partial(subprocess.run, cwd=ROOT, capture_output=True, text=True)
    commit = git(("git", "rev-parse", "--short=9", "HEAD"), check=True).stdout.strip()
    changed = git(("git", "diff", "--quiet", "HEAD", "--", *PARTS)).returncode
    commit += " with changes" if changed else ""
    return f"Measured with version {__version__}, commit {commit}, code {present_code()}."


@cache
def present_code() -> str:
    """Return the source hash of the checkout (12 hexadecimal digits)."""
    files = (path for part in PARTS for path in (ROOT / part).rglob("*") if path.is_file())
    return digest_of((path.relative_to(ROOT).as_posix(), path.read_bytes()) for path in files)


@cache
def code_of(commit: str) -> str:
    """Return the source hash of a commit (12 hexadecimal digits). Raises `CalledProcessError` for an unknown commit."""
    archive = subprocess.run(("git", "archive", commit, *PARTS), cwd=ROOT, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        return digest_of((each.name, tar.extractfile(each).read()) for each in tar if each.isfile())


def checked(page: str) -> str:
    """Return the text of a page after adding the sentence `LATER` to blocks measured with other code, and removing the
    sentence from all other blocks."""
    for name, text in statements(page).items():
        plain = text.replace(f" {LATER}", "")
        found = STATEMENT.match(plain)
        if found is None:
            raise SystemExit(f"block <!-- {name} -->: version, commit and code are missing: {text}")
        same = (present_code(), *EQUAL.get(present_code(), ()))
        page = put(page, name, plain if found["code"] in same else f"{plain} {LATER}")
    return page


def statements(page: str) -> dict[str, str]:
    return {found["name"]: found["text"] for found in BLOCK.finditer(page)}


def digest_of(files: Iterable[tuple[str, bytes]]) -> str:
    """Return a digest of the names and contents of files (12 hexadecimal digits)."""
    digest = sha256()
    for name, content in sorted(files):
        if "__pycache__" not in name:
            digest.update(f"{name}\0".encode() + (_code(content) if name.endswith(".py") else content))
    return digest.hexdigest()[:12]


def _code(content: bytes) -> bytes:
    """Return the content of a Python file without comments, docstrings, `raise` statements and blank lines."""
    lines = [line.split("  # ")[0] for line in content.decode("utf-8").split("\n")]
    for node in ast.walk(ast.parse(content)):
        value = node.value if isinstance(node, ast.Expr) else None
        if isinstance(node, ast.Raise) or (isinstance(value, ast.Constant) and isinstance(value.value, str)):
            lines[node.lineno - 1 : node.end_lineno] = [""] * (node.end_lineno - node.lineno + 1)
    return "\n".join(line for line in lines if line.strip() and not line.lstrip().startswith("#")).encode()
