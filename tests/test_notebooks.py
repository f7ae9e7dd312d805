"""Notebooks: their cells run with the stated results."""

import re
import subprocess
import sys

import pytest
from notebooks import BOOKS, FOLDER, SHORTER, code, executed, lengths


def test_first_drive_notebook_shows_imu_reduces_slope_error(tmp_path):
    """On a slope, the position estimate has an error that an inertial unit reduces."""
    wrong = "{name: abs(log.column('y') - log.column('y_hat'))[-100:].mean() for name, log in logs.items()}"
    said, (wrong, lines) = executed(tmp_path, "first_drive", False, f"[{wrong}, [len(a.lines) for a in axes]]")
    assert said.count("completed") == 3
    assert wrong["level"] < 0.05
    assert wrong["slope"] > 0.15
    assert wrong["slope, inertial unit"] < wrong["slope"] / 2
    assert lines == [2, 2, 2]
    assert (tmp_path / "figure.png").is_file()


@lengths
def test_notebook_with_a_custom_law_runs(tmp_path, full):
    """The registered law runs. Errors are larger on a slope and with a worn valve, and the complete map is printed."""
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


@pytest.mark.parametrize("name", BOOKS)
def test_notebook_file_has_no_outputs_and_ends_with_links(name):
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
def test_notebook_installs_the_package_if_it_is_missing(name, inside, tmp_path, monkeypatch):
    """The source is the checkout of the notebook, or the package index."""
    called = []
    monkeypatch.setattr("importlib.util.find_spec", lambda package: None)
    monkeypatch.setattr(subprocess, "run", lambda words, check: called.append(words))
    monkeypatch.chdir(FOLDER if inside else tmp_path)
    exec(code(BOOKS[name])[0], {})
    assert called == [[sys.executable, "-m", "pip", "install", "-q", "../.." if inside else "agrobot-mj"]]
