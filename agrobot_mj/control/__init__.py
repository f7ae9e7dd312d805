"""Controllers: the kinematic law, the low-level loops and the yaw controllers. The union is the registry."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.control.yaw import OpenLoop, Pd, PdIsgn, PdT1fnn, PdT2fnn

Controller = Annotated[OpenLoop | Pd | PdT2fnn | PdT1fnn | PdIsgn, Field(discriminator="kind")]
"""Every yaw controller, by `kind`."""

__all__ = ["Controller", "OpenLoop", "Pd", "PdIsgn", "PdT1fnn", "PdT2fnn"]
