"""Tables of docs/extensions/fields/field_studies.md: headland turns, area effects of guidance errors, and all machines
and laws on four fields."""

import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from estimates import student_interval
from scipy.stats import nct, norm
from sweeps import Blocks, Row, Study

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.extensions.fields.boom import Boom
from agrobot_mj.extensions.fields.coverage import areas
from agrobot_mj.extensions.fields.drive import driving_scenario, planning_scenario
from agrobot_mj.extensions.fields.evaluation import FieldDrive
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.plan import Plan, to_json
from agrobot_mj.extensions.fields.planned import planned_coverage
from agrobot_mj.extensions.fields.planner.area import inside_laps, whole_of
from agrobot_mj.extensions.fields.planner.joins import depth_of_turn
from agrobot_mj.extensions.fields.planner.planning import Options, make_plan
from agrobot_mj.extensions.fields.planner.rig import FieldMachine, rig_of
from agrobot_mj.extensions.fields.planner.swaths import SwathFrame
from agrobot_mj.extensions.fields.reading import read_field
from agrobot_mj.metrics import RunView
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import run

Keys = tuple[tuple[str, Any], ...]  # Overrides of a scenario by dotted key
LAWS, TURNS = ("lqr", "stanley", "kinematic"), ("omega", "bulb", "clothoid", "k")
FIELD_LAWS = ("lqr", "stanley", "pure_pursuit")
"""Laws of the table of fields."""
FORWARD_LAWS = ("feedforward", "kinematic", "learned_feedforward")
"""Laws that do not follow a path in reverse; their plans of fields have no reverse segments."""
WIDTHS_M = {"riding": 1.5, "robot": 2.0, "orchard": 2.5, "compact": 3.0, "utility": 4.0, "row_crop": 6.0}
"""Working width of each machine in the table of machines [m]. Assumed values."""
COMPACT_LAWS = ("nmpc", "eso", "ilc", "implement_ilc", "learned_feedforward")
"""Laws of the table of machines that only the compact tractor uses: a slow law, and laws that contain another law."""
ALL_LAWS = ("lqr", "stanley", "pure_pursuit", "feedforward", "kinematic", *COMPACT_LAWS)
VALVES: dict[str, Keys] = {
    "new": (),
    "worn": (("steering.valve.dead_band_v", 0.8),),
    "idling engine": (("steering.valve.engine_speed_share", 0.4),),
}
RAISED: Keys = (("implement.kind", "mounted"), ("implement.lowered", False))
DRAWN: Keys = (("implement.kind", "drawn"),)
IMPLEMENTS = {"1.8 m": (1.8, ()), "3 m mounted": (3.0, RAISED), "3 m drawn": (3.0, DRAWN)}
"""Working width [m] and overrides of each implement, by name."""
PROBABILITY, CONFIDENCE = 0.95, 0.9  # Quantile of the distances, and confidence of all intervals [-]
BEYOND_M = 20.0  # Distance by which the planned path may extend beyond the swaths [m]


SLOPE: Keys = (("terrain.kind", "slope"), ("terrain.grade_deg", 6.0))
CONDITIONS: dict[str, tuple[Keys, Keys]] = {
    "reference": ((), ()),
    "position error of 5 cm": ((), (("sensors.gnss.sigma_m", 0.05),)),
    "antenna 5 cm from its configured position": ((), (("sensors.gnss.configured_left_m", 0.05),)),
    "drawn implement": (DRAWN, ()),
    "slope of 6 deg": ((), SLOPE),
    "worn valve": ((), VALVES["worn"]),
}
"""Conditions on the rectangular field: overrides used in the plan, and overrides used only in the simulation."""
PUBLIC = {"Dutch, 3.59 ha": "test.json", "Estonian, three holes": "ee_field_130.wkt"}
"""Field files in the source package of Fields2Cover, by field name."""
OWN = {
    "rectangle": shapely.box(-75, -50, 75, 50),
    "own, obstacle, slope": shapely.Polygon(
        [(-110, -70), (90, -85), (110, 20), (60, 75), (-95, 70)], [[(-8, -6), (8, -6), (8, 6), (-8, 6)]]
    ),
}
"""Boundaries [m] of the other fields, whose areas are 1.5 and 2.9 ha."""
OVERLAPS_M = (0.0, 0.05, 0.1, 0.2, 0.3)
"""Planned overlaps [m]: working width minus distance between passes."""
LEAST_PERCENT = 0.05  # Minimum decrease of the missed area for which a break-even ratio is stated [percentage points]


TURNS_SAID = (
    "The compact tractor drives parallel swaths at 2 m/s, with turns on open ground. The *planned depth* is the "
    "distance by which the planned turn extends beyond the ends of the swaths, with tractor and implement. The "
    "plan assumes a new valve. The worn valve has a dead band of 0.8 V, and the idling engine gives 40 % of the "
    "pump flow. The first table gives the distance beyond the planned depth: the 95th percentile of a normal "
    "distribution fitted to the turns, and the confidence interval of this percentile. The second table gives the "
    "maximum depth with `lqr` and a new valve, and time and area per turn. Intervals have a confidence of 90 %. "
    "Failed runs are not averaged."
)
FIELDS_SAID = (
    "The compact tractor works each field with passes of 3 m at 2 m/s. The plan includes the implement, but neither "
    "the slope nor the other conditions. Two fields are in the source package of Fields2Cover on PyPI, which the "
    "command downloads. The columns *planned* are the overlaps and gaps of the plan itself, in corners and at oblique "
    "edges. The second table is for the body of the fields. *Break-even* is the ratio of yield value to input cost "
    "per hectare above which the additional planned overlap lowers the total cost. Published overlaps on farms are "
    "3.3 % at planting and 7 % at tillage without guidance (Iowa, 2011), and 5 % by hand and 2.5 % with guidance at "
    "mowing (Wisconsin, 2011). Intervals have a confidence of 90 %. Failed runs are not averaged."
)
"""Descriptions of the tables of headland turns and of fields."""


class Drive(NamedTuple):
    """Parameters of a simulated drive: table labels, implement, law, seed and size."""

    place: str  # Type of the turns, or name of the field
    valve: str
    implement: str
    law: str
    seed: int
    size: tuple[float, ...]  # Number and length [m] of the swaths, empty for a field
    width: float
    keys: Keys


def driven(
    field: Field, drive: Drive, options: Options, keys: Keys, forward_only: bool = False
) -> tuple[Log, FieldDrive]:
    """Plan a field without the overrides `keys`, simulate the plan with these overrides, and return the log and its
    evaluation."""
    base, rig, plan = planned(field, drive.width, drive.keys, options, forward_only)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "field_plan.json"
        file.write_text(json.dumps(to_json(plan)), encoding="utf-8")
        changes = {**dict(drive.keys), **dict(keys), "guidance.kind": drive.law, "seed": drive.seed}
        log = run(driving_scenario(field, plan, file, base, changes))
    whole = whole_of(field)
    return log, FieldDrive(RunView(log), plan, whole, inside_laps(whole, plan), rig, Boom(drive.width))


@lru_cache(maxsize=8)
def planned(
    field: Field, width: float, keys: Keys, options: Options, forward_only: bool
) -> tuple[Scenario, FieldMachine, Plan]:
    """Return the scenario for planning, the data of its machine, and the plan of a field."""
    path = {"transition": "none" if options.turn == "omega" else "clothoid", "speed_m_s": 2.0}
    base = planning_scenario(field.name, path, dict(keys))
    rig = rig_of(base, width, forward_only=forward_only)
    return base, rig, make_plan(field, rig, options)


def turned(drive: Drive) -> Row:
    """Simulate turns between parallel swaths. Return a row with the extent of the turns beyond the swaths.

    A row without a plan for the turns counts as failed.
    """
    count, length = drive.size
    body = shapely.box(0, 0, length, count * drive.width)
    field, shape = Field("swaths", body), drive.place
    options = Options(0, shape, frame=SwathFrame(0.0), beyond=BEYOND_M)  # type: ignore[arg-type]
    try:
        log, drove = driven(field, drive, options, VALVES[drive.valve])
    except ScenarioError as error:
        return {**drive._asdict(), "ends": "refused", "expected": False, "reason": str(error)}
    row = {**drive._asdict(), "ends": log.outcome, "expected": log.as_expected}
    if log.as_expected:
        turns, found = drove.turns(), areas(drove.coverage)["body"]
        row["reach"] = [turn["swept_width_m"] for turn in turns]
        row["planned"] = depth_of_turn(drove.rig, shape)  # type: ignore[arg-type]
        row["turn_s"] = float(np.mean([turn["time_s"] for turn in turns]))
        row["missed"], row["overlapped"] = (found[f"{key}_m2"] / len(turns) for key in ("missed", "overlapped"))
    return row


def headlands(study: Study) -> Blocks:
    """Return tables of headland turns: distance beyond the planned depth, and time and area per turn."""
    size, seeds = (5, 30.0), 10
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
        good = [row for row in some if row["expected"]]
        planned = f"{good[0]['planned']:.1f}" if good else "-"
        for valve in VALVES:
            each = ([row for row in some if (row["valve"], row["law"]) == (valve, law)] for law in LAWS)
            beyond.append((implement, f"`{turn}`", valve, planned, *map(_beyond, each)))
        if normal := [row for row in good if (row["valve"], row["law"]) == ("new", "lqr")]:
            means = (_mean([row[key] for row in normal]) for key in ("turn_s", "missed", "overlapped"))
            used.append((implement, f"`{turn}`", f"{max(max(row['reach']) for row in normal):.1f}", *means))
    heads = ("implement", "turn", "valve", "planned depth [m]", *(f"`{law}`, beyond planned depth [m]" for law in LAWS))
    costs = ("implement", "turn", "depth used [m]", "time [s]", "missed [m2]", "overlapped [m2]")
    failed = f"{sum(not row['expected'] for row in rows)} failed"
    return {
        "headlands": markdown_table(heads, beyond, 3),
        "headland turns": markdown_table(costs, used, 2),
        "headland runs": f"{TURNS_SAID} {size[0] - 1} turns per run, {seeds} seeds: {len(rows)} runs, {failed}.",
    }


def public_fields(folder: Path) -> dict[str, Path]:
    """Return the field files in a source package on PyPI by name, or an empty dict if the package is not available."""
    if not list(folder.glob("fields2cover-*.tar.gz")):
        pip, tools = [sys.executable, "-m", "pip", "-q"], folder / "tools"
        source = ("--no-deps", "--no-binary", ":all:", "--no-build-isolation", "--dest", str(folder), "fields2cover")
        for command in (["install", "--target", str(tools), "scikit-build-core"], ["download", *source]):
            subprocess.run([*pip, *command], env={**os.environ, "PYTHONPATH": str(tools)}, check=False)
    for package in list(folder.glob("fields2cover-*.tar.gz"))[:1]:
        with tarfile.open(package) as archive:
            members = [each for each in archive.getmembers() if "/data/" in each.name and each.isfile()]
            archive.extractall(folder, members, filter="data")
        found = {Path(each.name).name: folder / each.name for each in members}
        return {name: found[file] for name, file in PUBLIC.items() if file in found}
    return {}


def worked(job: tuple[Drive, str, Keys]) -> Row:
    """Simulate the work on a field. Return a row with the overlapped and missed area for each planned overlap
    [%], and the maximum distance of the machine beyond the boundary [m].

    `job` contains the drive, the field file (may be empty), and overrides not used in the plan.
    """
    drive, file, unknown = job
    field = read_field(Path(file)) if file else Field(drive.place, OWN[drive.place])
    row = {**drive._asdict(), "area_m2": field.boundary.area}
    try:
        log, drove = driven(field, drive, Options(), unknown, drive.law in FORWARD_LAWS)
    except ScenarioError as error:
        return {**row, "ends": "refused", "expected": False, "reason": str(error)}
    row |= {"ends": log.outcome, "expected": log.as_expected, "reason": log.metrics.get("stop_reason")}
    if log.as_expected:
        wide = [replace(drove, boom=Boom(drive.width + overlap)) for overlap in OVERLAPS_M]
        row["whole"], row["body"] = (
            [_shares(areas(each.coverage)[part]) for each in wide] for part in ("field", "body")
        )
        row["planned"] = _shares(areas(planned_coverage(drove.plan, drove.field, drove.body))["field"])
        row["out"] = {name: found["largest_m"] for name, found in drove.excursions().items()}
    return row


def _shares(part: dict[str, float]) -> tuple[float, float]:
    return part["overlapped_percent"], part["missed_percent"]


def guidance(study: Study) -> Blocks:
    """Return tables of overlapped and missed areas on four fields and in several conditions, by planned overlap."""
    files, seeds = field_files(study), 10
    pairs = [(place, "reference") for place in files] + [("rectangle", each) for each in CONDITIONS]
    cells = list(product(dict.fromkeys(pairs), FIELD_LAWS))
    jobs = [
        (
            Drive(place, condition, "3 m", law, seed, (), 3.0, known),
            files[place],
            unknown + SLOPE * ("slope" in place),
        )
        for (place, condition), law in cells
        for seed in range(1, seeds + 1)
        for known, unknown in (CONDITIONS[condition],)
    ]
    rows = study.done("coverage", worked, jobs)
    if not rows:
        return {}
    lines, curve = [], []
    for (place, condition), law in cells:
        some = [row for row in rows if (row["place"], row["valve"], row["law"]) == (place, condition, law)]
        good = [row for row in some if row["expected"]]
        shares = [_mean([row["whole"][0][k] for row in good]) for k in range(2)]
        planned = [f"{good[0]['planned'][k]:.2f}" if good else "-" for k in range(2)]
        area, failed = f"{some[0]['area_m2'] / 1e4:.2f}", f"{len(some) - len(good)} of {len(some)}"
        lines.append((place, area, condition, f"`{law}`", shares[0], planned[0], shares[1], planned[1], failed))
    for law in FIELD_LAWS:
        good = [row for row in rows if row["expected"] and (row["law"], row["valve"]) == (law, "reference")]
        means = np.mean([row["body"] for row in good], axis=0) if good else ()
        for k, overlap in enumerate(OVERLAPS_M[: len(means)]):
            more, less = means[k] - means[k - 1] if k else (0.0, 0.0)
            ratio = f"{-more / less:.1f}" if less < -LEAST_PERCENT else "-"
            each = (_mean([row["body"][k][j] for row in good]) for j in range(2))
            curve.append((f"`{law}`", f"{100 * overlap:g}", *each, ratio))
    heads = ("field", "area [ha]", "condition", "law", "overlapped [%]", "planned", "missed [%]", "planned", "failed")
    steps = ("law", "planned overlap [cm]", "overlapped [%]", "missed [%]", "break-even")
    lost = Counter(row["ends"] for row in rows if not row["expected"])
    ends = ", ".join(f"{count} {end}" for end, count in lost.items()) or "none"
    said = f"{FIELDS_SAID} {seeds} seeds: {len(rows)} runs; failed: {ends}."
    said += "" if len(files) > len(OWN) else " The public fields were not available."
    return {
        "coverage": markdown_table(heads, lines, 4),
        "planned overlap": markdown_table(steps, curve, 1),
        "coverage runs": said,
    }


def field_files(study: Study) -> dict[str, str]:
    """Return the names of the four fields with their files. The name is empty for own fields, and public fields are
    missing if their package is not available."""
    public = public_fields(study.runs / "public")
    return dict.fromkeys(OWN, "") | {name: str(file) for name, file in public.items()}


def machines(study: Study) -> Blocks:
    """Return a table of all machines and laws, with `COMPACT_LAWS` on the compact tractor only: maximum distance beyond
    the boundary on each field."""
    files = field_files(study)
    pairs = [
        (machine, law)
        for machine, law in product(WIDTHS_M, ALL_LAWS)
        if machine == "compact" or law not in COMPACT_LAWS
    ]
    jobs = [
        (
            Drive(place, "reference", machine, law, 1, (), WIDTHS_M[machine], (("machine", machine),)),
            files[place],
            SLOPE * ("slope" in place),
        )
        for (machine, law), place in product(pairs, files)
    ]
    rows = study.done("machines", worked, jobs)
    lines = []
    for machine, law in pairs:
        some = [row for row in rows if (row["implement"], row["law"]) == (machine, law)]
        lines.append((f"`{machine}`", f"{WIDTHS_M[machine]:g}", f"`{law}`", *map(_inside, some)))
    return {"machines": markdown_table(("machine", "width [m]", "law", *files), lines, 3)} if rows else {}


def _inside(row: Row) -> str:
    """Return a table cell with the distance of tractor and implement beyond the boundary [m], or the reason of a
    failure."""
    if row["expected"]:
        return f"{row['out']['tractor']:.2f} / {row['out']['implement']:.2f}"
    return str(row["reason"] or row["ends"]).partition("; ")[0]


def _beyond(rows: Sequence[Row]) -> str:
    """Return a table cell with a quantile of the distance beyond the planned depth, its interval and failed runs."""
    good = [reach - row["planned"] for row in rows if row["expected"] for reach in row["reach"]]
    done = sum(row["expected"] for row in rows)
    lost = f"{len(rows) - done} of {len(rows)} failed"
    if len(good) < 2:
        return lost
    middle, spread, root = float(np.mean(good)), float(np.std(good, ddof=1)), len(good) ** 0.5
    z = float(norm.ppf(PROBABILITY))
    ends = nct.ppf([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], len(good) - 1, z * root) / root
    low, high = (middle + float(k) * spread for k in ends)
    return f"{middle + z * spread:.2f} ({low:.2f} to {high:.2f})" + (f", {lost}" if done < len(rows) else "")


def _mean(values: Sequence[float]) -> str:
    """Return a table cell with the mean and the half width of its confidence interval."""
    if len(values) < 2:
        return "-"
    low, high = student_interval(values, CONFIDENCE)
    return f"{np.mean(values):.2f} ± {(high - low) / 2:.2f}"


PARTS = {"headlands": headlands, "coverage": guidance, "machines": machines}
