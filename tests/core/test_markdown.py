"""Markdown tables: alignment, escaped separators, padding for terminals, and rows of wrong length."""

import pytest

from agrobot_mj.core.markdown import markdown_table


def test_text_cells_are_left_aligned_and_numbers_right_aligned():
    table = markdown_table(("law", "error [m]"), [("pd", 0.5), ("stanley", "-")], numbers_from=1)
    assert table == "| law | error [m] |\n|---|---:|\n| pd | 0.5 |\n| stanley | - |"


def test_cell_separators_in_cells_are_escaped():
    assert markdown_table(("a",), [("x|y",)]).splitlines()[2] == "| x\\|y |"


def test_cells_are_padded_to_column_width_for_terminals():
    lines = markdown_table(("law", "m"), [("stanley", 1), ("", 10)], numbers_from=1, aligned=True).splitlines()
    assert lines == ["| law     |  m |", "|---------|---:|", "| stanley |  1 |", "|         | 10 |"]


def test_row_with_a_different_number_of_cells_is_rejected():
    with pytest.raises(ValueError, match="shorter"):
        markdown_table(("a", "b"), [("x",)])
