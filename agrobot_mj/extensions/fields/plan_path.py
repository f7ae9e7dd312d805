"""Path along a plan of field work from a file, with its passes, turns and cusps."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, PrivateAttr

from agrobot_mj.core.resources import Stamp, stamp
from agrobot_mj.extensions.fields.plan import Plan, plan_of, stamp_of
from agrobot_mj.paths.profile import Timed
from agrobot_mj.paths.track import Course


class FieldPlan(Timed):
    """Path along a plan of field work."""

    kind: Literal["field_plan"] = "field_plan"
    reads_file: ClassVar[bool] = True
    """Always True: the course comes from a file."""
    file: Annotated[str, Field(max_length=4000)] = "plan.json"
    """Plan file written by `agrobot-mj field plan`."""

    _stamp: Stamp | None = PrivateAttr(default=None)
    """Stamp of the file content from which the course was built."""

    def model_post_init(self, context: Any, /) -> None:
        """Record the stamp of the file without reading it, so that paths with equal keys and different files differ."""
        self._stamp = stamp(self.file)

    @property
    def plan(self) -> Plan:
        """Plan of the file. Raise ValueError if the file is invalid."""
        try:
            self._stamp = self._stamp or stamp_of(self.file)
            return plan_of(self._stamp)
        except ValueError as error:
            raise ValueError(f"file: {error}") from None

    def check(self) -> None:
        """Check the file before reading it, then build the course. Raise ValueError if it is invalid."""
        try:
            stamp_of(self.file)
        except ValueError as error:
            raise ValueError(f"file: {error}") from None
        super().check()

    def course(self) -> Course:
        """Return the segments of the plan."""
        return self.plan.course
