"""Generation of the page on safety from four sweeps.

Sweeps: `faults` (one failure of a sensor or actuator per run), `receivers` (failures recorded on a real tractor),
`farthest` (maximum errors with a drifting position), and `sane` (runs without failure).
"""

import json
from collections import Counter, defaultdict
from collections.abc import Iterable

import numpy as np
from sweeps import Blocks, Row, Study

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.metrics.safety import OFF_M

HEADS = ("failure", "runs", "stopped", "after [s]", "off the path at the end [m]", "largest [m]")
HEADS += ("speed divided by command", "reason")
FASTEST, LATE_S, FAR_M = 1.5, 5.0, 2.0
"""Acceptance limits: speed divided by its command [-], and time [s] or distance off the path [m] within which a tractor
must stop."""
BARS = {
    "fast": f"faster than {FASTEST} x its command",
    "far": f"farther off than {FAR_M:g} m and later than {LATE_S:g} s",
    "never": f"farther off than {OFF_M:g} m and not stopped",
}


def safety(study: Study) -> Blocks:
    sane, failures = ([row for row in study.rows(name) if not row["error"]] for name in ("sane", "faults"))
    if not (sane and failures):
        return {}
    return {"failures": failures_table(failures, sane), "bars": bars_table(failures), "sane": sane_text(sane)}


def failure(row: Row) -> str:
    faults = json.loads(row["fault"]) if isinstance(row["fault"], str) else row["fault"]
    return " and ".join(map(_one, faults))


def _one(fault: Row) -> str:
    keys = [f"`{k} = {v}`" for k, v in fault.items() if k not in ("kind", "start_s", "end_s") and v is not None]
    lasts = [f"for {fault['end_s'] - fault['start_s']:.3g} s"] if fault.get("end_s") else []
    return ", ".join([f"`{fault['kind']}`", *keys, *lasts])


def beyond(row: Row) -> list[str]:
    """Return the names of the acceptance limits that a run violates."""
    found = [] if row["safety.overspeed"] <= FASTEST else ["fast"]
    if row["safety.offset_max"] <= OFF_M:
        return found
    far = row["safety.offset_end"] > FAR_M and row["safety.off_s"] > LATE_S
    return found + (["never"] if row["safety.stop_s"] is None else ["far"] if far else [])


def spread(values: Iterable[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{np.median(known):.2f} ({max(known):.2f})" if known else "-"


def stops(rows: Iterable[Row]) -> Counter[str]:
    """Return the number of runs stopped by the supervisor, by stop reason."""
    return Counter(str(row["stop_reason"]) for row in rows if row["outcome"] == "stopped")


def failures_table(rows: list[Row], sane: list[Row]) -> str:
    """Return a table with one row per fault, over all laws, terrains and seeds, and one row without fault."""
    groups = defaultdict(list)
    for row in rows:
        groups[failure(row)].append(row)
    lines = []
    for name, some in groups.items():
        keys = ("stop_s", "offset_end", "offset_max", "overspeed")
        stopped = sum(row["safety.stop_s"] is not None for row in some)
        reason = "".join(reason for reason, _ in stops(some).most_common(1))
        lines.append(
            (name, len(some), stopped, *(spread(row[f"safety.{key}"] for row in some) for key in keys), reason)
        )
    lines.append(("none", len(sane), stops(sane).total(), *"----", "; ".join(stops(sane))))
    return markdown_table(HEADS, lines)


def receivers(study: Study) -> Blocks:
    """Return a table of receiver failures with stopping distance and maximum deviation from the path."""
    groups = defaultdict(list)
    for row in study.rows("receivers"):
        groups[failure(row)].append(row)
    lines = []
    for name, some in groups.items():
        stopped = [row for row in some if row["outcome"] == "stopped"]
        ways = (spread(row[f"safety.{key}"] for row in rows) for key, rows in (("way", stopped), ("offset_max", some)))
        reason = "".join(reason for reason, _ in stops(some).most_common(1))
        lines.append((name, len(some), len(stopped), spread(row["safety.stop_s"] for row in some), *ways, reason))
    heads = ("failure", "runs", "stopped", "after [s]", "distance to standstill [m]", "maximum deviation [m]", "reason")
    return {"receivers": markdown_table(heads, lines)} if lines else {}


def farthest(study: Study) -> Blocks:
    """Return a table of the maximum deviation of each law, separately for runs without and with a stop."""
    rows = [row for row in study.rows("farthest") if row.get("safety.offset_max") is not None]
    lines = []
    for law in dict.fromkeys(row["guidance.kind"] for row in rows):
        of_law = [row for row in rows if row["guidance.kind"] == law]
        for stopped in (False, True):
            some = [row for row in of_law if (row["safety.stop_s"] is not None) == stopped]
            far = max(some, key=lambda row: row["safety.offset_max"], default=None)
            if far:
                drawn = (f"`{key}` {far[f'fault.0.{key}']:.2g}" for key in ("start_s", "north_m_s", "east_m_s"))
                numbers = (f"{far[f'safety.{key}']:.2f}" for key in ("offset_max", "overspeed"))
                counts = (law, len(of_law), "yes" if stopped else "no", len(some))
                reason = str(far["stop_reason"] or "")
                lines.append((*counts, *numbers, ", ".join([far["variant"], *drawn]), reason))
    heads = (
        "law",
        "runs",
        "stopped",
        "of them",
        "maximum deviation [m]",
        "speed divided by command",
        "failure",
        "reason",
    )
    return {"farthest": markdown_table(heads, lines) if lines else ""}


def bars_table(rows: list[Row]) -> str:
    """Return a table of runs that violate an acceptance limit, by fault and law."""
    broken = Counter((bar, failure(row), row["variant"]) for row in rows for bar in beyond(row))
    lines = [(BARS[bar], name, law, n) for (bar, name, law), n in sorted(broken.items())]
    return (
        markdown_table(("acceptance limit", "failure", "law", "runs"), lines)
        if broken
        else "All runs are within the acceptance limits."
    )


def sane_text(rows: list[Row]) -> str:
    """Return a text with the number of runs without fault, and with a list of the stopped runs among them."""
    stopped = [row for row in rows if row["outcome"] == "stopped"]
    lines = [f"{len(rows)} runs without failures, of which {len(stopped)} were stopped."]
    for row in stopped:
        lines.append(f"- {row['variant']}, {row['terrain']}, {row['path.speed_m_s']} m/s: {row['stop_reason']}")
    return "\n".join(lines)


PARTS = {"safety": safety, "receivers": receivers, "farthest": farthest}
