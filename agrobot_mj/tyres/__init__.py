"""Tyre models for the force between wheel and ground: one module per tyre law, and a common contact patch."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.tyres.base import TyreBase
from agrobot_mj.tyres.contact import Contact
from agrobot_mj.tyres.linear import Linear
from agrobot_mj.tyres.magic_formula import MagicFormula
from agrobot_mj.tyres.ruts import Ruts
from agrobot_mj.tyres.soil import Soil

Tyre = Annotated[
    Contact
    | Linear
    | MagicFormula
    | Soil
    | Ruts,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = ["Contact", "Linear", "MagicFormula", "Ruts", "Soil", "Tyre", "TyreBase"]
