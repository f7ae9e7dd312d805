"""Tables in Markdown: the one place where reports, pages and scripts get theirs from."""

from collections.abc import Iterable, Sequence


def markdown_table(
    heads: Sequence[object], rows: Iterable[Sequence[object]], numbers_from: int | None = None, aligned: bool = False
) -> str:
    """Table without a final newline, a line for each row; a `|` within a cell is escaped.

    Columns from `numbers_from` on, counted from 0, have their values to the right; `aligned` fills cells up with
    spaces, for a terminal. Raises ValueError where a row has not as many cells as there are `heads`.
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
