"""No implement."""

from typing import ClassVar, Literal

from agrobot_mj.machine.implements.base import ImplementBase, Rig
from agrobot_mj.machine.tractor import TractorParameters


class NoImplement(ImplementBase):
    """The tractor alone."""

    machine: ClassVar[bool] = False

    kind: Literal["none"] = "none"

    def rig(self, tractor: TractorParameters) -> Rig | None:
        """Nothing."""
        return None
