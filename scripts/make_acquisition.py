"""docs/guidance.md's table of lines acquired: run the sweep `acquisition` (resumes by itself), and write its table."""

import argparse
from pathlib import Path

import pyarrow.parquet as pq
from blocks import put

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.metrics.success import error_of
from agrobot_mj.studies.sweep import SweepOptions, sweep

ROOT = Path(__file__).parent.parent
PAGE, FOLDER = ROOT / "docs" / "guidance.md", ROOT / "runs" / "acquisition"
LAW, SPEED = "guidance.kind", "path.speed_m_s"
START = (SPEED, "path.start_offset_m", "path.start_heading_deg")


def table(rows: list[dict]) -> str:
    """A row for each law and speed."""
    best: dict[tuple, float] = {}
    for row in rows:
        if (seconds := acquired_s(row)) is not None:
            best[start(row)] = min(seconds, best.get(start(row), seconds))
    lines = []
    for law in sorted({row[LAW] for row in rows}):
        for speed in sorted({row[SPEED] for row in rows}):
            lines.append(line(law, speed, [row for row in rows if (row[LAW], row[SPEED]) == (law, speed)], best))
    heads = ("law", "speed [m/s]", "starts acquired", "overshoot [m]", "time, mean, longest [s]", "over the best")
    return markdown_table(heads, lines, 1)


def line(law: str, speed: float, some: list[dict], best: dict[tuple, float]) -> tuple[str, ...]:
    """How a law comes onto the line at a speed, and its time over that of the fastest law from the same starts."""
    times = {start(row): seconds for row in some if (seconds := acquired_s(row)) is not None}
    over = max(row["acquisition.overshoot_m"] for row in some)
    if not times:
        return f"`{law}`", f"{speed:g}", f"0 of {len(some)}", f"{over:.2f}", "-", "-"
    mean, ratio = sum(times.values()) / len(times), sum(times.values()) / sum(best[key] for key in times)
    counts = f"{len(times)} of {len(some)}", f"{over:.2f}", f"{mean:.1f}, {max(times.values()):.1f}"
    return f"`{law}`", f"{speed:g}", *counts, f"{ratio:.2f}"


def start(row: dict) -> tuple:
    """Speed, offset and heading."""
    return tuple(row[key] for key in START)


def acquired_s(row: dict) -> float | None:
    """Time until it stays on the line; None if it does not [s]."""
    return error_of(row, "acquisition.acquired_s")


def main() -> None:
    """Sweep what is missing, and print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=FOLDER)
    given = parser.parse_args()
    sweep("acquisition", given.out, SweepOptions(jobs=given.jobs))
    rows = pq.read_table(given.out / "sweep.parquet").to_pylist()
    text = table(rows)
    PAGE.write_text(put(PAGE.read_text(encoding="utf-8"), "acquisition", text), encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
