"""Path files of Fields2Cover: rows of x, y, z, heading [rad], speed [m/s], length [m], direction and type.

The direction is 1 (forward) or -1 (reverse). The type is 1 (swath), 2 (turn) or 3 (swath on the headland).
"""

import numpy as np

from agrobot_mj.paths.imports import Polyline, ShapeFile

WIDTH, TURN = 8, 2  # Number of values in a row, and value of the type column that marks a turn


def _row(line: str) -> list[float]:
    """Return the numbers in a line of text, or an empty list unless the line has `WIDTH` finite numbers."""
    try:
        found = [float(cell) for cell in line.replace(",", " ").split()]
    except ValueError:
        return []
    return found if len(found) == WIDTH and np.isfinite(found).all() else []


def is_fields2cover(head: str) -> bool:
    """Return whether the first row of `head`, the start of a file, is a row of a Fields2Cover path."""
    row = _row(next((line for line in head.splitlines() if line.strip()), ""))
    return bool(row) and row[6] in (-1, 1) and row[7] in (1, 2, 3)


def read_fields2cover(text: str) -> ShapeFile:
    """Return the path in the text of a Fields2Cover file. Each point has a speed, a direction and a working state.

    Raise a ValueError that names the first invalid row.
    """
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip():
            rows.append(_row(line))
            if not rows[-1]:
                raise ValueError(f"row {number}: the row does not have {WIDTH} numbers; save the path again")
    values = np.array(rows)
    x, y, _, heading, speed, length, direction, kind = values.T
    travelled = length[-1] * direction[-1]
    end = [x[-1] + travelled * np.cos(heading[-1]), y[-1] + travelled * np.sin(heading[-1])]
    points = np.vstack([np.column_stack([x, y]), end])
    columns = {"speed": speed, "direction": direction, "working": (kind != TURN).astype(float)}
    repeated = {name: np.append(column, column[-1]) for name, column in columns.items()}
    return ShapeFile((Polyline(points, columns=repeated),))
