"""Evaluation of simulated field work from the log of the run: coverage, excursions, turns and field capacity."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, cast

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.boom import THIN_M, Boom, ImplementMotion, Times, switching_times, worked_area
from agrobot_mj.extensions.fields.coverage import FieldCoverage, areas, coverage, excursion, gaps
from agrobot_mj.extensions.fields.crop_rows import CropRows, run_over
from agrobot_mj.extensions.fields.effort import NO_PRICES, Prices, cost, effort
from agrobot_mj.extensions.fields.operations import WorkedPass, capacity, pass_to_pass, summary, turn_of
from agrobot_mj.extensions.fields.plan import Plan, PlannedPass
from agrobot_mj.extensions.fields.plan_path import FieldPlan
from agrobot_mj.extensions.fields.planned import planned_coverage, planned_motion
from agrobot_mj.extensions.fields.planner.area import BLOCK
from agrobot_mj.extensions.fields.planner.rig import FieldMachine, implement_boxes, tractor_boxes
from agrobot_mj.extensions.fields.raster import PassMap, pass_map
from agrobot_mj.metrics import RunView
from agrobot_mj.paths.profile import TimedCourse
from agrobot_mj.paths.track import Index
from agrobot_mj.simulation.log import Log

SIGNALS = ("t", "x", "y", "yaw", "implement_x", "implement_y", "hitch_angle")
"""Names of the signals of a run that determine the trajectory of the implement."""
AROUND_M = 5.0
"""Distance before and after a pass in which the sections of the implement may be switched [m]."""


@dataclass(frozen=True)
class FieldDrive:
    """Simulated field work: run, plan, areas of the field, and data of the machine."""

    view: RunView
    plan: Plan
    field: BaseGeometry  # Area of the field without obstacles
    body: BaseGeometry  # Body of the field: area inside the headland laps, which the swaths cover
    rig: FieldMachine
    boom: Boom
    prices: Prices = NO_PRICES
    rows: CropRows | None = None

    @cached_property
    def log(self) -> Log:
        """Log of the run until the CG passes the end of the plan. A law without speed feedback may arrive early, and
        then drives on until the reference arrives."""
        whole = cast(Log, self.view.log)
        after = np.flatnonzero(self._travelled_distances >= self._timed.distances[-1])
        if not after.size or after[0] + 1 == whole.rows.filled:
            return whole
        rows = copy(whole.rows)
        rows.filled = int(after[0]) + 1
        return replace(whole, rows=rows)

    @cached_property
    def motion(self) -> ImplementMotion:
        """Trajectory of the working point of the implement during the run."""
        column = self.log.column
        x, y, yaw = (column(name) for name in ("x", "y", "yaw"))
        ahead = np.cos(yaw) * (column("x_hat") - x) + np.sin(yaw) * (column("y_hat") - y)
        signals = {name: column(name) for name in SIGNALS if name in self.log.rows.columns}
        travelled = self._travelled_distances[: len(x)]
        return implement_motion(signals, self.plan.behind, travelled + np.nan_to_num(ahead))

    @property
    def _timed(self) -> TimedCourse:
        return cast(FieldPlan, self.view.path).motion

    @cached_property
    def _travelled_distances(self) -> Array:
        """Arc length of the plan at the position of the CG in each tick [m], shape (ticks,)."""
        beside, timed = self.view.cg_on_path, self._timed
        k = np.clip(np.searchsorted(timed.times, np.nan_to_num(beside.time), "right") - 1, 0, len(timed.speeds) - 2)
        dt = beside.time - timed.times[k]
        gain = (timed.speeds[k + 1] - timed.speeds[k]) / (timed.times[k + 1] - timed.times[k])
        x, y, yaw = beside.circles.T[:3]
        ahead = np.cos(yaw) * (self.view.column("x") - x) + np.sin(yaw) * (self.view.column("y") - y)
        found: Array = timed.distances[k] + dt * (timed.speeds[k] + gain * dt / 2) + timed.course.directions[k] * ahead
        return found

    @cached_property
    def times(self) -> list[list[Times | None]]:
        """Working interval of each section in each pass [s], or None for a section without work."""
        reached = np.maximum.accumulate(self.motion.s)

        def of(one: PlannedPass) -> list[Times | None]:
            speed = self.rig.path.speed_m_s
            late = speed * (self.boom.on_delay + self.boom.off_delay)
            first, last = np.searchsorted(reached, [one.start - AROUND_M - late, one.end + AROUND_M + late])
            rows = slice(int(first), int(last))
            return [switching_times(self.motion, span, rows, self.boom) for span in one.sections]

        return [of(one) for one in self.plan.passes]

    @cached_property
    def coverage(self) -> FieldCoverage:
        """Coverage of the field, computed from the ground that the sections worked."""
        ground = [worked_area(self.motion, times, self.boom) for times in self.times]
        return coverage(self.field, self.body, [each for each in ground if not each.is_empty])

    @cached_property
    def pass_map(self) -> PassMap:
        """Number of passes in each cell of the field."""
        return pass_map(self.coverage)

    def outlines(self, rows: Index) -> dict[str, Array]:
        """Return the outlines of the tractor and of the implement at the log rows `rows` (n,), as polygons (n,) by
        name."""
        column, motion = self.log.column, self.motion
        at = np.searchsorted(motion.t, column("t")[rows]).clip(0, len(motion.t) - 1)
        implement = implement_boxes(self.rig, motion.x[at], motion.y[at], motion.yaw[at])
        return {
            "tractor": tractor_boxes(self.rig, *(column(n)[rows] for n in ("x", "y", "yaw"))),
            "implement": implement,
        }

    def excursions(self) -> dict[str, Any]:
        """Return the excursions of the tractor and of the implement beyond the boundary, by name."""
        shapely.prepare(self.field)
        found: dict[str, list[Array]] = {}
        for first in range(0, max(len(self._thin), 1), BLOCK):
            for name, boxes in self.outlines(self._thin[first : first + BLOCK]).items():
                found.setdefault(name, []).append(boxes[~shapely.covers(self.field, boxes)])
        return excursion({name: np.concatenate(parts) for name, parts in found.items()}, self.field)

    @property
    def track(self) -> Array:
        """Positions of the CG about every 0.5 m of the track, shape (n, 2) [m]."""
        return np.column_stack([self.log.column(name)[self._thin] for name in ("x", "y")])

    @cached_property
    def _thin(self) -> Index:
        """Indices of log rows at a spacing of about 0.5 m along the track."""
        x, y = self.log.column("x"), self.log.column("y")
        travelled = np.concatenate(([0.0], np.cumsum(np.nan_to_num(np.hypot(np.diff(x), np.diff(y))))))
        rows: Index = np.flatnonzero(np.diff(np.floor(travelled / THIN_M), prepend=-1.0) > 0)
        kept: Index = rows[np.isfinite(x[rows])]
        return kept

    def spans(self) -> list[Times | None]:
        """Return the working interval of each pass [s], from the first start to the last stop of a section, or None for
        a pass without work."""
        found: list[Times | None] = []
        for times in self.times:
            some = [each for each in times if each is not None]
            found.append((min(a for a, _ in some), max(b for _, b in some)) if some else None)
        return found

    def turns(self) -> list[dict[str, float]]:
        """Return the position, duration, swept width and peak steering angle of each turn between two swaths."""
        t, steer = self.log.column("t"), self.log.column("steer")
        thin = t[self._thin]
        found = []
        for (one, before), (other, after) in pairwise(zip(self.plan.passes, self.spans(), strict=True)):
            if one.part != "body" or other.part != "body" or before is None or after is None or after[0] <= before[1]:
                continue
            rows = (t >= before[1]) & (t <= after[0])
            inside = self._thin[(thin >= before[1]) & (thin <= after[0])]
            if rows.sum() < 2 or not inside.size:
                continue
            boxes = np.concatenate(list(self.outlines(inside).values()))
            end = self.motion.at(np.array([before[1]]))
            found.append(turn_of(boxes, (end.x[0], end.y[0], end.yaw[0]), t[rows], steer[rows]))
        return found

    def swaths(self) -> list[WorkedPass]:
        """Return the planned and the actual motion of the implement on each swath inside the headland."""
        planned = planned_motion(self.plan)
        return [
            WorkedPass(planned.between(one.start, one.end), self.motion.between(*span))
            for one, span in zip(self.plan.passes, self.spans(), strict=True)
            if one.part == "body" and span is not None
        ]


def implement_motion(signals: Mapping[str, Array], behind: float, s: Array) -> ImplementMotion:
    """Return the trajectory of the working point of the implement from the signals of a run, shape (n,) each.

    Without the signals of an implement, the working point is `behind` [m] behind the CG. `s` is the arc length [m].
    """
    t, x, y, yaw = (signals[name] for name in ("t", "x", "y", "yaw"))
    if "implement_x" in signals:
        at = signals["implement_x"], signals["implement_y"], yaw + signals["hitch_angle"]
    else:
        at = x - behind * np.cos(yaw), y - behind * np.sin(yaw), yaw
    found = ImplementMotion(t, *at, s)
    good = np.logical_and.reduce([np.isfinite(values) for values in found])
    if good.sum() < 2:
        raise ScenarioError("the run ended before the implement moved; no coverage is available")
    kept = found if good.all() else ImplementMotion(*(values[good] for values in found))
    return kept._replace(yaw=np.unwrap(kept.yaw))


def report(drive: FieldDrive) -> dict[str, Any]:
    """Return all results of simulated field work as JSON values, including a summary sentence."""
    found, turns, log = drive.coverage, drive.turns(), drive.log
    by_part, t = areas(found), log.column("t")
    x, y = log.column("x"), log.column("y")
    span = float(t[-1] - t[0])
    content = {
        "field": drive.plan.name,
        "outcome": log.outcome,
        "width_m": drive.plan.width,
        "sections": drive.boom.sections,
        "areas": by_part,
        "gaps": gaps(found),
        "excursions": drive.excursions(),
        "turns": summary(turns),
        "each_turn": turns,
        "distance_m": float(np.nansum(np.hypot(np.diff(x), np.diff(y)))),
        "working_distance_m": float(sum(_length(drive.motion, span) for span in drive.spans() if span)),
        "time_s": span,
        "capacity": capacity(by_part["field"]["worked_m2"], span, drive.plan.width, drive.rig.path.speed_m_s),
        "accuracy": pass_to_pass(drive.swaths(), drive.plan.width - drive.plan.overlap),
        "effort": effort(log),
        "planned": areas(planned_coverage(drive.plan, drive.field, drive.body)),
        "plan_warnings": list(drive.plan.warnings),
    }
    if any(drive.prices):
        content["cost"] = cost(drive.prices, by_part["field"], span)
    if drive.rows is not None:
        content["crop_rows"] = run_over(drive.rows, drive.plan, drive.body, drive.rig, log)
    return {**content, "summary": sentence(content)}


def _length(motion: ImplementMotion, span: Times) -> float:
    part = motion.between(*span)
    return float(np.hypot(np.diff(part.x), np.diff(part.y)).sum())


def sentence(content: dict[str, Any]) -> str:
    """Return a summary of the results in one sentence: coverage, gaps, excursions and crop rows."""
    whole = content["areas"]["field"]
    hectares = f"{whole['worked_m2'] / 1e4:.3g} of {whole['area_m2'] / 1e4:.3g} ha worked at least once"
    text = f"{hectares}, {whole['overlapped_percent']:.1f} % overlapped, {whole['missed_percent']:.1f} % missed"
    found = content["gaps"]
    out = {name: each for name, each in content["excursions"].items() if each["largest_m"] > 0.05}
    if found and whole["missed_percent"] >= 0.05:
        share = 100 * found[0]["area_m2"] / sum(each["area_m2"] for each in found)
        text += f"; {share:.0f} % of the missed area is in the {found[0]['place']}"
    for name, each in out.items():
        text += f"; the {name} left the field by {each['largest_m']:.1f} m in the {each['side']}"
    if rows := content.get("crop_rows"):
        metres = f"{rows['run_over_m']:.3g}" if rows["run_over_m"] < 100 else f"{rows['run_over_m']:.0f}"
        text += f"; {metres} m of crop rows run over ({rows['run_over_percent']:.2g} %)"
    return text
