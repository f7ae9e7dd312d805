"""Base of the faults of a line: one from a sensor, or one to a valve. `core.lines` says what becomes of the signal."""

from typing import Any, ClassVar

from agrobot_mj.core.signals import Conditions
from agrobot_mj.faults.base import Scripted


class LineFault(Scripted):
    """A fault of one line, named as its field of `Conditions`; an effect overrides `apply` and calls `distorted`."""

    line: ClassVar[str]
    """Field of `Conditions` with the distortion of the line."""

    def distorted(self, conditions: Conditions, **changes: Any) -> Conditions:
        """Conditions with these fields of the line's distortion changed."""
        return conditions._replace(**{self.line: getattr(conditions, self.line)._replace(**changes)})
