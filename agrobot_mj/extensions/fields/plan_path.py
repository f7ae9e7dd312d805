"""Path along a field work plan stored in a file, with passes, turns and cusps."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from agrobot_mj.extensions.fields.plan import MAX_BYTES, SUFFIXES, Plan, plan_of
from agrobot_mj.paths.from_file import FromFile
from agrobot_mj.paths.track import Course


class FieldPlan(FromFile):
    """Path along a field work plan stored in a file."""

    kind: Literal["field_plan"] = "field_plan"
    suffixes: ClassVar[tuple[str, ...]] = SUFFIXES
    max_bytes: ClassVar[int] = MAX_BYTES
    file: Annotated[str, Field(max_length=4000)] = "field_plan.json"
    """Plan file written by `agrobot-mj field plan`."""

    @property
    def plan(self) -> Plan:
        """Plan stored in `file`. Raises ValueError if the file is invalid."""
        return self.content(plan_of)

    def course(self) -> Course:
        """Return the geometry of the planned path."""
        return self.plan.course
