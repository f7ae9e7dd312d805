"""Notebooks whose cells run in order without a kernel. Simulations are shortened, except with `-m slow`."""

import json
from pathlib import Path

import pytest
from processes import program
from removed import REMOVED

FOLDER = Path(__file__).parents[1] / "examples" / "notebooks"
TEXTS = {file.stem: file.read_text(encoding="utf-8") for file in sorted(FOLDER.glob("*.ipynb"))}
GONE = tuple(f"agrobot_mj.extensions.{name}" for name in REMOVED)
BOOKS = {name: json.loads(text) for name, text in TEXTS.items() if not any(module in text for module in GONE)}
"""Notebooks that need no removed extension."""
SHORTER = {
    "first_drive": [('"duration_s": 20', '"duration_s": 12')],
    "own_law": [('"duration_s": 20', '"duration_s": 4'), ("(0, 10, 20), (0.4, 1.5, 3.0)", "(0, 20), (0.4, 3.0)")],
    "boundary_to_report": [("EAST, NORTH = 70, 45", "EAST, NORTH = 40, 26")],
    "log_to_twin": [('"duration_s": 60', '"duration_s": 30'), ('"guidance.kind": "lqr"', '"duration_s": 2')],
}
"""Replacements in the code of each notebook that shorten it."""


def code(book):
    return ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"]


def executed(folder, name, full, found):
    """Execute the cells of a notebook in order in a separate process. Return their output and the values of `found`.

    A separate process is necessary because laws cannot be unregistered. Displayed figures are rendered.
    """
    head = "import json\nimport matplotlib.pyplot as plt\nplt.show = lambda: plt.gcf().savefig('figure.png')"
    cells = code(BOOKS[name])
    for before, after in [] if full else SHORTER[name]:
        cells = [cell.replace(before, after) for cell in cells]
    done = program(folder, "\n\n".join([head, *cells, f"print(json.dumps({found}))"]))
    assert (done.returncode, done.stderr) == (0, "")
    *said, last = done.stdout.splitlines()
    return "\n".join(said), json.loads(last)


lengths = pytest.mark.parametrize("full", [False, pytest.param(True, marks=pytest.mark.slow)])
