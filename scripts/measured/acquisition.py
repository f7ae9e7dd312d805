"""Tables about line acquisition on the page guidance_tables, from the sweep `acquisition`."""

from collections.abc import Sequence
from math import cos, radians, sin, tan

from sweeps import Blocks, Row, Study

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.machine.tractor import COMPACT
from agrobot_mj.metrics.success import error_of

LAW, SPEED = "guidance.kind", "path.speed_m_s"
OFFSET, HEADING = "path.start_offset_m", "path.start_heading_deg"
START = (SPEED, OFFSET, HEADING)
HEADS = ("law", "speed [m/s]", "starts acquired", "overshoot [m]", "time, mean, longest [s]", "over the best")


def acquisition(study: Study) -> Blocks:
    """Return two tables of acquisition times. The first is for starts parallel to the line or away from the line, the
    second for starts towards the line."""
    rows = study.rows("acquisition")
    return {
        "acquisition": table([row for row in rows if row[HEADING] >= 0]),
        "acquisition towards": table([row for row in rows if row[HEADING] < 0]),
    }


def table(rows: Sequence[Row]) -> str:
    best: dict[tuple[float, ...], float] = {}
    for begin, seconds in (pair for row in rows for pair in acquired(row).items()):
        best[begin] = min(seconds, best.get(begin, seconds))
    groups = sorted({(row[LAW], row[SPEED]) for row in rows})
    lines = [line(*group, [row for row in rows if (row[LAW], row[SPEED]) == group], best) for group in groups]
    return markdown_table(HEADS, lines, 1) if lines else ""


def line(law: str, speed: float, some: Sequence[Row], best: dict[tuple[float, ...], float]) -> tuple[str, ...]:
    """Return the table row of a law at a speed. `best` contains the minimum acquisition time over all laws [s], by
    start."""
    times = {begin: seconds for row in some for begin, seconds in acquired(row).items()}
    overshoots = [row["acquisition.overshoot_m"] for row in some if not row["error"] and has_room(row)]
    counts = f"{len(times)} of {len(some)}", f"{max(overshoots):.2f}" if overshoots else "-"
    found = (f"`{law}`", f"{speed:g}", *counts)
    if not times:
        return (*found, "-", "-")
    mean, over = sum(times.values()) / len(times), sum(times.values()) / sum(best[begin] for begin in times)
    return (*found, f"{mean:.1f}, {max(times.values()):.1f}", f"{over:.2f}")


def has_room(row: Row) -> bool:
    """Return whether the tractor can turn parallel to the line, at maximum steering angle, before it reaches the line.

    The rear axle turns at R = L / tan(limit). In a rotation by theta, the CG, l_r ahead of the rear axle, approaches
    the line by R (1 - cos theta) - l_r sin theta.
    """
    theta, radius = radians(max(-row[HEADING], 0.0)), COMPACT.wheelbase_m / tan(COMPACT.steer_limit)
    return bool(radius * (1 - cos(theta)) - COMPACT.cg_to_rear_axle * sin(theta) <= row[OFFSET])


def acquired(row: Row) -> dict[tuple[float, ...], float]:
    """Return the acquisition time of a run [s] by start (speed, offset, heading), or an empty dict if the line was not
    acquired."""
    seconds = error_of(row, "acquisition.acquired_s")
    return {} if seconds is None else {tuple(row[key] for key in START): seconds}


PARTS = {"acquisition": acquisition}
