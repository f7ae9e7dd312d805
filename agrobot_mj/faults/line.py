"""Base of the faults of a line: one from a sensor, or one to a valve. `core.lines` says what becomes of the signal."""

from typing import Any

from agrobot_mj.core.signals import Conditions, Distortion
from agrobot_mj.faults.base import Scripted


class LineFault(Scripted):
    """A fault of one line; its kind is the line's field of `Conditions` and the effect: `gyro_stuck`.

    An effect overrides `apply` and calls `distorted`.
    """

    @property
    def line(self) -> str:
        """Field of `Conditions` with the distortion of the line."""
        return self.kind.rpartition("_")[0]

    def distortion(self, conditions: Conditions) -> Distortion:
        """What the line suffers so far in this tick."""
        found: Distortion = getattr(conditions, self.line)
        return found

    def distorted(self, conditions: Conditions, **changes: Any) -> Conditions:
        """Conditions with these fields of the line's distortion changed."""
        changed: dict[str, Any] = {self.line: self.distortion(conditions)._replace(**changes)}
        return conditions._replace(**changed)
