"""Tables of docs/extensions/fields/field_studies.md: turns on headlands, and the cost of guidance errors on fields.

By default, sizes are those of the page's tables; `--full` runs the full size (days of one core).
"""

import json
import tempfile
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy.stats import nct, norm, t
from sweeps import Blocks, Row, Study

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.extensions.fields.boom import Boom
from agrobot_mj.extensions.fields.coverage import areas, excursion
from agrobot_mj.extensions.fields.drive import driving_scenario, planning_scenario
from agrobot_mj.extensions.fields.evaluation import FieldDrive
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.plan import to_json
from agrobot_mj.extensions.fields.planner.area import inside_laps, whole_of
from agrobot_mj.extensions.fields.planner.joins import depth_of_turn
from agrobot_mj.extensions.fields.planner.planning import Options, make_plan
from agrobot_mj.extensions.fields.planner.rig import rig_of
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import run

Keys = tuple[tuple[str, Any], ...]
"""Overrides of a scenario by dotted key."""
LAWS, TURNS = ("lqr", "stanley", "kinematic"), ("omega", "bulb", "clothoid", "k")
VALVES: dict[str, Keys] = {
    "new": (),
    "worn": (("steering.valve.dead_band_v", 0.8),),
    "idling engine": (("steering.valve.engine_speed_share", 0.4),),
}
RAISED: Keys = (("implement.kind", "mounted"), ("implement.lowered", False))
DRAWN: Keys = (("implement.kind", "drawn"),)
IMPLEMENTS = {"1.8 m": (1.8, ()), "3 m mounted": (3.0, RAISED), "3 m drawn": (3.0, DRAWN)}
"""Width [m] and keys of each implement."""
PROBABILITY, CONFIDENCE = 0.95, 0.9
"""Quantile of the distances, and confidence of all intervals [-]."""
BEYOND_M, OPEN_M = 20.0, 60.0
"""Distance that the plan may leave the swaths [m], and width of the open ground at their sides [m]."""


class Drive(NamedTuple):
    """Run of a study, with its labels and all that defines it."""

    place: str
    """Type of the turns, or name of the field."""
    valve: str
    implement: str
    law: str
    seed: int
    size: tuple[float, ...]
    """Number and length [m] of the swaths, or scale of the field."""
    width: float
    keys: Keys


def driven(field: Field, drive: Drive, options: Options, keys: Keys) -> tuple[Log, FieldDrive]:
    """Plan a field without knowledge of the keys `keys`, simulate the plan with them, and return the drive."""
    known = dict(drive.keys)
    path = {"transition": "none" if options.turn == "omega" else "clothoid", "speed_m_s": 2.0}
    base = planning_scenario(field.name, path, known)
    rig = rig_of(base, drive.width)
    plan = make_plan(field, rig, options)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "field_plan.json"
        file.write_text(json.dumps(to_json(plan)), encoding="utf-8")
        changes = {**known, **dict(keys), "guidance.kind": drive.law, "seed": drive.seed}
        log = run(driving_scenario(field, plan, file, base, changes))
    whole = whole_of(field)
    return log, FieldDrive(log, plan, whole, inside_laps(whole, plan), rig, Boom(drive.width))


def turned(drive: Drive) -> Row:
    """Simulate parallel swaths with open ground at their ends, and return how far the turns extend beyond the ends."""
    count, length = drive.size
    body = shapely.box(0, 0, length, count * drive.width)
    field, shape = Field("swaths", body), drive.place
    log, drove = driven(field, drive, Options(0, shape, angle=0.0, beyond=BEYOND_M), VALVES[drive.valve])  # type: ignore[arg-type]
    row = {**drive._asdict(), "ends": log.outcome, "expected": log.as_expected}
    if log.as_expected:
        wide = shapely.box(0, -OPEN_M, length, count * drive.width + OPEN_M)
        turns, found = drove.turns(), areas(drove.coverage)["body"]
        row["reach"] = max(out["largest_m"] for out in excursion(drove.outlines, wide).values())
        row["planned"] = depth_of_turn(drove.rig, shape)  # type: ignore[arg-type]
        row["turn_s"] = float(np.mean([turn["time_s"] for turn in turns]))
        row["missed"], row["overlapped"] = (found[f"{key}_m2"] / len(turns) for key in ("missed", "overlapped"))
    return row


def headlands(study: Study) -> Blocks:
    """Return the distances beyond a headland of the planned depth, and the time and area that turns take."""
    size, seeds = ((9, 40.0), 10) if study.full else ((3, 16.0), 3)
    cells = list(product(TURNS, VALVES, IMPLEMENTS, LAWS))
    jobs = [
        Drive(turn, valve, implement, law, seed, size, *IMPLEMENTS[implement])
        for seed in range(1, seeds + 1)
        for turn, valve, implement, law in cells
    ]
    rows = study.done("headlands", turned, jobs)
    if not rows:
        return {}
    beyond, used = [], []
    for implement, turn in product(IMPLEMENTS, TURNS):
        some = [row for row in rows if (row["implement"], row["place"]) == (implement, turn)]
        if not (good := [row for row in some if row["expected"]]):
            continue
        planned = good[0]["planned"]
        for valve in VALVES:
            each = ([row for row in some if (row["valve"], row["law"]) == (valve, law)] for law in LAWS)
            beyond.append((implement, f"`{turn}`", valve, f"{planned:.1f}", *map(_beyond, each)))
        if normal := [row for row in good if (row["valve"], row["law"]) == ("new", "lqr")]:
            means = (_mean([row[key] for row in normal]) for key in ("turn_s", "missed", "overlapped"))
            used.append((implement, f"`{turn}`", f"{max(row['reach'] for row in normal):.1f}", *means))
    heads = ("implement", "turn", "valve", "planned depth [m]", *(f"`{law}`, beyond it [m]" for law in LAWS))
    costs = ("implement", "turn", "depth used [m]", "time [s]", "missed [m2]", "overlapped [m2]")
    failed = f"{sum(not row['expected'] for row in rows)} failed"
    return {
        "headlands": markdown_table(heads, beyond, 3),
        "headland turns": markdown_table(costs, used, 2),
        "headland runs": f"{size[0] - 1} turns per run, {seeds} seeds: {len(rows)} runs, {failed}.",
    }


def _beyond(rows: Sequence[Row]) -> str:
    """Return quantile and interval of the distance beyond the planned depth, with the number of failed runs."""
    good = [row["reach"] - row["planned"] for row in rows if row["expected"]]
    lost = f"{len(rows) - len(good)} of {len(rows)} failed"
    if len(good) < 2:
        return lost
    middle, spread, root = float(np.mean(good)), float(np.std(good, ddof=1)), len(good) ** 0.5
    z = float(norm.ppf(PROBABILITY))
    ends = nct.ppf([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], len(good) - 1, z * root) / root
    low, high = (middle + float(k) * spread for k in ends)
    return f"{middle + z * spread:.2f} ({low:.2f} to {high:.2f})" + (f", {lost}" if len(good) < len(rows) else "")


def _mean(values: Sequence[float]) -> str:
    """Return mean and half width of the confidence interval of a mean."""
    if len(values) < 2:
        return "-"
    half = float(t.ppf((1 + CONFIDENCE) / 2, len(values) - 1) * np.std(values, ddof=1) / len(values) ** 0.5)
    return f"{np.mean(values):.2f} ± {half:.2f}"


PARTS = {"headlands": headlands}
