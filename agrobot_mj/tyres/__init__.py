"""Tyres as connections between wheel and ground: one file a law, the contact patch shared."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.tyres.contact import Contact
from agrobot_mj.tyres.linear import Linear

Tyre = Annotated[Contact | Linear, Field(discriminator="kind")]

__all__ = ["Contact", "Linear", "Tyre"]
