"""Implements at the hitch of the tractor, with one module per kind of implement."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.machine.implements.base import HitchedBody, ImplementBase, NoImplement, TowedImplement
from agrobot_mj.machine.implements.draught import Tool
from agrobot_mj.machine.implements.drawn import Drawn
from agrobot_mj.machine.implements.mounted import Mounted

Implement = Annotated[
    NoImplement
    | Mounted
    | Drawn,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = ["Drawn", "HitchedBody", "Implement", "ImplementBase", "Mounted", "NoImplement", "Tool", "TowedImplement"]
