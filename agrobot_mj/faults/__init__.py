"""Scripted faults and disturbances, one module per affected component. A fault changes the `Conditions` of a tick."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.faults.base import Scripted
from agrobot_mj.faults.gnss import GnssDgps, GnssDrift, GnssFloat, GnssFrozen, GnssJump, GnssLatency, GnssLoss
from agrobot_mj.faults.line import (
    AttitudeBias,
    Delayed,
    GyroBias,
    HeadingBias,
    Lost,
    PedalPotBias,
    Scaled,
    SteeringPotBias,
    Stuck,
)
from agrobot_mj.faults.machine import Drawbar, Friction, Payload, SideForce, SoftTyre, ValveWear
from agrobot_mj.faults.script import Script, ScriptState, clashes, loadings

Fault = Annotated[
    GnssDgps
    | GnssDrift
    | GnssFloat
    | GnssFrozen
    | GnssJump
    | GnssLatency
    | GnssLoss
    | Stuck
    | Scaled
    | Lost
    | Delayed
    | SteeringPotBias
    | PedalPotBias
    | GyroBias
    | HeadingBias
    | AttitudeBias
    | ValveWear
    | SoftTyre
    | Friction
    | Payload
    | Drawbar
    | SideForce,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = ["Fault", "Script", "ScriptState", "Scripted", "clashes", "loadings"]
