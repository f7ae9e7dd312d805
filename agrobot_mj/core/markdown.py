"""Markdown tables for reports, pages and scripts."""

from collections.abc import Iterable, Sequence


def markdown_table(
    heads: Sequence[object], rows: Iterable[Sequence[object]], numbers_from: int | None = None, aligned: bool = False
) -> str:
    """Return a Markdown table without a final newline. A `|` within a cell is escaped.

    Columns from index `numbers_from` on are right-aligned. If `aligned`, cells are padded to equal width for a
    terminal. Raises ValueError if a row and `heads` have different lengths.
    """
    lines = [[str(cell).replace("|", "\\|") for cell in row] for row in (heads, *rows)]
    widths = [max(map(len, column)) if aligned else 1 for column in zip(*lines, strict=True)]
    right = [numbers_from is not None and k >= numbers_from for k in range(len(heads))]
    columns = list(zip(widths, right, strict=True))
    rule = "|".join("-" * max(width + 2 - end, 3) + ":" * end for width, end in columns)
    texts = [
        " | ".join(f"{cell:{'>' if end else '<'}{width}}" for cell, (width, end) in zip(line, columns, strict=True))
        for line in lines
    ]
    return "\n".join([f"| {texts[0]} |", f"|{rule}|", *(f"| {text} |" for text in texts[1:])])
