"""Guidance laws, yaw controllers and steering loops, with a union type for each of the three families."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.control.base import AngleLoop, GuidanceLaw, Situation, YawController
from agrobot_mj.control.feedforward import Feedforward
from agrobot_mj.control.kinematic import Kinematic
from agrobot_mj.control.laws import InnerLaw
from agrobot_mj.control.lqr import Lqr
from agrobot_mj.control.nmpc import Nmpc
from agrobot_mj.control.open_loop import OpenLoop
from agrobot_mj.control.pd import Pd
from agrobot_mj.control.pd_fnn import PdT1fnn, PdT2fnn
from agrobot_mj.control.pd_isgn import PdIsgn
from agrobot_mj.control.pi import Pi
from agrobot_mj.control.pid import SpeedLoop, SteeringLoop
from agrobot_mj.control.pure_pursuit import PurePursuit
from agrobot_mj.control.stanley import Stanley

Guidance = Annotated[InnerLaw, Field(discriminator="kind")]
"""Union type of the built-in guidance laws; the key `kind` selects the law."""

Controller = Annotated[
    OpenLoop
    | Pd
    | Pi
    | PdT2fnn
    | PdT1fnn
    | PdIsgn,
    Field(discriminator="kind"),
]  # fmt: skip
"""Union type of the yaw controllers; the key `kind` selects the controller."""

Loop = Annotated[SteeringLoop, Field(discriminator="kind")]
"""Union type of the built-in steering loops; the key `kind` selects the loop."""

__all__ = [
    "AngleLoop",
    "Controller",
    "Feedforward",
    "Guidance",
    "GuidanceLaw",
    "Kinematic",
    "Loop",
    "Lqr",
    "Nmpc",
    "OpenLoop",
    "Pd",
    "PdIsgn",
    "PdT1fnn",
    "PdT2fnn",
    "Pi",
    "PurePursuit",
    "Situation",
    "SpeedLoop",
    "Stanley",
    "SteeringLoop",
    "YawController",
]
