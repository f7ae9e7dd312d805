"""What hangs at the hitch: one file per kind."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.machine.implements.base import HitchedBody, ImplementBase
from agrobot_mj.machine.implements.drawn import Drawn
from agrobot_mj.machine.implements.mounted import Mounted
from agrobot_mj.machine.implements.none import NoImplement
from agrobot_mj.machine.implements.tool import Tool

Implement = Annotated[
    NoImplement
    | Mounted
    | Drawn,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = ["Drawn", "HitchedBody", "Implement", "ImplementBase", "Mounted", "NoImplement", "Tool"]
