"""Tables in Markdown."""

import pytest

from agrobot_mj.core.markdown import markdown_table


def test_aligns_words_left_and_numbers_right():
    table = markdown_table(("law", "error [m]"), [("pd", 0.5), ("stanley", "-")], numbers_from=1)
    assert table == "| law | error [m] |\n|---|---:|\n| pd | 0.5 |\n| stanley | - |"


def test_escapes_cell_separators():
    assert markdown_table(("a",), [("x|y",)]).splitlines()[2] == "| x\\|y |"


def test_pads_cells_for_a_terminal():
    lines = markdown_table(("law", "m"), [("stanley", 1), ("", 10)], numbers_from=1, aligned=True).splitlines()
    assert lines == ["| law     |  m |", "|---------|---:|", "| stanley |  1 |", "|         | 10 |"]


def test_rejects_a_row_of_another_length():
    with pytest.raises(ValueError, match="shorter"):
        markdown_table(("a", "b"), [("x",)])
