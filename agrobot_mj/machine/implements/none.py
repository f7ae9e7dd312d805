"""No implement."""

from typing import ClassVar, Literal

from agrobot_mj.machine.implements.base import HitchedBody, ImplementBase
from agrobot_mj.machine.tractor import TractorParameters


class NoImplement(ImplementBase):
    """The tractor alone."""

    machine: ClassVar[bool] = False

    kind: Literal["none"] = "none"

    def hitched(self, tractor: TractorParameters) -> HitchedBody | None:
        """Nothing."""
        return None
