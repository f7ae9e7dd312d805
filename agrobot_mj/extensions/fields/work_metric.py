"""Metric of field work for comparisons and sweeps: coverage of the field, and excursions beyond the boundary."""

from typing import Any, ClassVar, Literal, cast

from agrobot_mj.core.signals import Column
from agrobot_mj.extensions.fields.plan_path import FieldPlan
from agrobot_mj.metrics import Metric, RunView
from agrobot_mj.scenario.schema import Scenario


class FieldWork(Metric):
    """Coverage of a field and excursions beyond its boundary. The sections of the implement switch without delay."""

    kind: Literal["field_work"] = "field_work"
    columns: ClassVar[tuple[Column, ...]] = (
        Column("field_overlapped_percent", "%", "area worked more than once"),
        Column("field_missed_percent", "%", "area of the field that is not worked"),
        Column("tractor_beyond_m", "m", "maximum distance of the tractor beyond the boundary"),
        Column("implement_beyond_m", "m", "maximum distance of the implement beyond the boundary"),
        Column("field_turns_s", "s", "total time of the turns between swaths"),
        Column("field_hours", "h", "duration of the work"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return coverage and excursions. The result is empty without a field plan, and for runs without motion."""
        if not isinstance(view.path, FieldPlan) or not view.path.plan.ground:
            return {}
        import shapely

        from agrobot_mj.core.errors import ScenarioError
        from agrobot_mj.extensions.fields.boom import Boom
        from agrobot_mj.extensions.fields.coverage import areas
        from agrobot_mj.extensions.fields.evaluation import FieldDrive
        from agrobot_mj.extensions.fields.planner.area import inside_laps
        from agrobot_mj.extensions.fields.planner.rig import outline_of

        plan, scenario = view.path.plan, cast(Scenario, view.log.scenario)
        whole = shapely.from_wkt(plan.ground)
        sections = max((len(one.sections) for one in plan.passes), default=1)
        rig = outline_of(scenario, plan.width, plan.overlap)
        drive = FieldDrive(view, plan, whole, inside_laps(whole, plan), rig, Boom(plan.width, sections))
        try:
            found = areas(drive.coverage)["field"]
        except ScenarioError:  # the run ended before the implement moved
            return {}
        out = drive.excursions()
        return {
            "field_overlapped_percent": found["overlapped_percent"],
            "field_missed_percent": found["missed_percent"],
            "tractor_beyond_m": out["tractor"]["largest_m"],
            "implement_beyond_m": out["implement"]["largest_m"],
            "field_turns_s": float(sum(turn["time_s"] for turn in drive.turns())),
            "field_hours": float(drive.log.column("t")[-1]) / 3600,
        }
