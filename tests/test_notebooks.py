"""The notebooks are true: their cells run in order without a kernel, in shorter drives; in full with `-m slow`."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from processes import program

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "examples" / "notebooks"
BOOKS = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(FOLDER.glob("*.ipynb"))}
SHORTER = {
    "first_drive": [('"duration_s": 20', '"duration_s": 12')],
    "own_law": [('"duration_s": 20', '"duration_s": 4'), ("(0, 10, 20), (0.4, 1.5, 3.0)", "(0, 20), (0.4, 3.0)")],
    "log_to_twin": [('"duration_s": 60', '"duration_s": 30'), ('"guidance.kind": "lqr"', '"duration_s": 2')],
}
"""What makes a notebook quick: pieces of its text and what stands in their place."""


def code(book):
    return ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"]


def executed(folder, name, full, found):
    """What the cells print, executed one after the other in a process of their own, and the values of `found`.

    Of their own, since a law that is registered stays. A figure that is shown is drawn.
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


def test_first_drive(tmp_path):
    """On the slope the tractor is elsewhere than it believes, less so with an inertial unit."""
    wrong = "{name: abs(log.column('y') - log.column('y_hat'))[-100:].mean() for name, log in logs.items()}"
    said, (wrong, lines) = executed(tmp_path, "first_drive", False, f"[{wrong}, [len(a.lines) for a in axes]]")
    assert said.count("completed") == 3
    assert wrong["level"] < 0.05
    assert wrong["slope"] > 0.15
    assert wrong["slope, inertial unit"] < wrong["slope"] / 2
    assert lines == [2, 2, 2]
    assert (tmp_path / "figure.png").is_file()


@lengths
def test_own_law(tmp_path, full):
    """The registered law drives; slope and a worn valve make it worse, and every cell of the map is printed."""
    found = "[{k: v.tolist() for k, v in maps.items()}, [t.get_text() for a in axes for t in a.texts]]"
    _, (maps, texts) = executed(tmp_path, "own_law", full, found)
    assert set(maps) == {"two_gains", "lqr"}
    assert texts == [f"{value:.2f}" for errors in maps.values() for row in errors for value in row]
    assert maps["two_gains"] != maps["lqr"]
    if full:
        for law, bar in {"two_gains": 0.25, "lqr": 0.1}.items():  # two gains know of no delay between command and wheel
            assert maps[law][0][0] < bar
            assert maps[law][-1][-1] > 1.5 * maps[law][0][0]
    assert (tmp_path / "figure.png").is_file()


@lengths
def test_log_to_twin(tmp_path, full):
    """What the owner did not know is found within its interval, his centre is outside, and the twin drives."""
    pairs = "(found.found['steer.offset'], CENTRE), (found.found['steer.scale'], SCALE)"
    ends = f"[[found.low, hidden, found.high] for found, hidden in ({pairs})]"
    said, (centre, scale) = executed(tmp_path, "log_to_twin", full, ends)
    assert centre == sorted(centre)
    assert centre[-1] < 447
    assert scale == sorted(scale)
    assert "Your centre is about 43" in said
    assert re.search(r"^completed, \d", said, re.M)
    assert "Twin of field.csv" in (tmp_path / "machine.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", BOOKS)
def test_is_a_clean_notebook_that_ends_with_a_way_on(name):
    book = BOOKS[name]
    assert (book["nbformat"], book["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in book["cells"]}) == len(book["cells"])
    for cell in book["cells"]:
        assert (cell.get("outputs", []), cell.get("execution_count")) == ([], None)
    for before, _ in SHORTER[name]:
        assert any(before in cell for cell in code(book)), before
    links = re.findall(r"\]\((\S+)\)", "".join(book["cells"][-1]["source"]))
    assert links
    assert all((FOLDER / link).is_file() for link in links)


@pytest.mark.parametrize("name", BOOKS)
@pytest.mark.parametrize("inside", [True, False])
def test_installs_the_package_where_it_is_missing(name, inside, tmp_path, monkeypatch):
    """From the checkout around the notebook, or from the package index."""
    called = []
    monkeypatch.setattr("importlib.util.find_spec", lambda package: None)
    monkeypatch.setattr(subprocess, "run", lambda words, check: called.append(words))
    monkeypatch.chdir(FOLDER if inside else tmp_path)
    exec(code(BOOKS[name])[0], {})
    assert called == [[sys.executable, "-m", "pip", "install", "-q", "../.." if inside else "agrobot-mj"]]
