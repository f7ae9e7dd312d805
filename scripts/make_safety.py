"""docs/safety.md: fail sensors and actuators one by one, and drive where nothing fails; both sweeps resume."""

import argparse
import json
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from blocks import put

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.version import __version__
from agrobot_mj.metrics.safety import OFF_M
from agrobot_mj.studies.sweep import SweepOptions, sweep

ROOT = Path(__file__).parent.parent
PAGE, RUNS = ROOT / "docs" / "safety.md", ROOT / "runs" / "safety"
HEADS = (
    *("failure", "runs", "stopped", "after [s]", "off the path at the end [m]", "largest [m]"),
    *("speed over command", "reason"),
)
FASTEST, LATE_S, FAR_M = 1.5, 5.0, 2.0
"""Bars: speed over command [-]; a tractor `OFF_M` off its path stands within this time [s] or distance [m]."""

Row = dict[str, Any]


def failure(row: Row) -> str:
    """The failure of a run: its kind and keys."""
    (fault,) = json.loads(row["fault"]) if isinstance(row["fault"], str) else row["fault"]
    keys = ", ".join(f"`{k} = {v}`" for k, v in fault.items() if k not in ("kind", "start_s") and v is not None)
    return f"`{fault['kind']}`" + (f", {keys}" if keys else "")


def beyond(row: Row) -> list[str]:
    """The bars that a run breaks."""
    found = [] if row["safety.overspeed"] <= FASTEST else ["fast"]
    if row["safety.offset_max"] <= OFF_M:
        return found
    far = row["safety.offset_end"] > FAR_M and row["safety.off_s"] > LATE_S
    return found + (["never"] if row["safety.stop_s"] is None else ["far"] if far else [])


def spread(values: Iterable[float | None]) -> str:
    """Median and largest of the values that are there."""
    known = [value for value in values if value is not None]
    return f"{np.median(known):.2f} ({max(known):.2f})" if known else "-"


def failures_table(rows: list[Row], sane: list[Row]) -> str:
    """One line for each failure, over laws, grounds and seeds, and one for the runs in which nothing fails."""
    groups = defaultdict(list)
    for row in rows:
        groups[failure(row)].append(row)
    lines = []
    for name, some in groups.items():
        reasons = Counter(str(row["stop_reason"]) for row in some if row["outcome"] == "stopped")
        numbers = (
            spread(row[f"safety.{key}"] for row in some) for key in ("stop_s", "offset_end", "offset_max", "overspeed")
        )
        stopped = sum(row["safety.stop_s"] is not None for row in some)
        reason = reasons.most_common(1)[0][0] if reasons else ""
        lines.append((name, len(some), stopped, *numbers, reason))
    stops = Counter(str(row["stop_reason"]) for row in sane if row["outcome"] == "stopped")
    lines.append(("nothing", len(sane), stops.total(), *"----", "; ".join(stops)))
    return markdown_table(HEADS, lines)


def bars_table(rows: list[Row]) -> str:
    """Runs beyond a bar, by failure and law."""
    broken = Counter((bar, failure(row), row["variant"]) for row in rows for bar in beyond(row))
    words = {
        "fast": f"faster than {FASTEST} x its command",
        "far": f"farther off than {FAR_M:g} m and later than {LATE_S:g} s",
        "never": f"farther off than {OFF_M:g} m and not stopped",
    }
    lines = [(words[bar], name, law, n) for (bar, name, law), n in sorted(broken.items())]
    return markdown_table(("bar", "failure", "law", "runs"), lines) if broken else "No run is beyond a bar."


def sane_text(rows: list[Row]) -> str:
    """Runs in which nothing failed, and those of them that were stopped."""
    stops = [row for row in rows if row["outcome"] == "stopped"]
    lines = [f"{len(rows)} runs in which nothing fails, {len(stops)} stopped."]
    for row in stops:
        ground = row["terrain"]["kind"] if isinstance(row["terrain"], dict) else row["terrain"]
        lines.append(f"- {row['variant']}, {ground}, {row['path.speed_m_s']} m/s: {row['stop_reason']}")
    return "\n".join(lines)


def table_of(name: str) -> list[Row]:
    """The rows of a sweep that did not end with an error."""
    return [row for row in pq.read_table(RUNS / name / "sweep.parquet").to_pylist() if not row["error"]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--only-draw", action="store_true", help="run nothing, write the page from what is there")
    arguments = parser.parse_args()
    for name in () if arguments.only_draw else ("sane", "faults"):
        found = sweep(name, RUNS / name, SweepOptions(jobs=arguments.jobs))
        print(f"{name}: {found.total} runs, {found.errors} with an error")
    failures, sane = table_of("faults"), table_of("sane")
    text = PAGE.read_text(encoding="utf-8")
    text = put(text, "standing", f"Version {__version__}; {len(failures)} runs with a failure, {len(sane)} without.")
    text = put(text, "failures", failures_table(failures, sane))
    text = put(text, "bars", bars_table(failures))
    text = put(text, "sane", sane_text(sane))
    PAGE.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
