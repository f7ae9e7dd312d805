"""Scripted faults and disturbances: one file per kind, each changing the `Conditions` of a tick in its window."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.faults.base import Scripted
from agrobot_mj.faults.drawbar import Drawbar
from agrobot_mj.faults.friction import Friction
from agrobot_mj.faults.gnss_float import GnssFloat
from agrobot_mj.faults.gnss_latency import GnssLatency
from agrobot_mj.faults.gnss_loss import GnssLoss
from agrobot_mj.faults.payload import Payload
from agrobot_mj.faults.script import Script, ScriptState, clashes, loadings
from agrobot_mj.faults.side_force import SideForce
from agrobot_mj.faults.soft_tyre import SoftTyre
from agrobot_mj.faults.steering_pot_bias import SteeringPotBias
from agrobot_mj.faults.steering_pot_stuck import SteeringPotStuck
from agrobot_mj.faults.valve_wear import ValveWear

Fault = Annotated[
    Drawbar
    | Friction
    | GnssFloat
    | GnssLatency
    | GnssLoss
    | Payload
    | SideForce
    | SoftTyre
    | SteeringPotBias
    | SteeringPotStuck
    | ValveWear,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = [
    "Drawbar",
    "Fault",
    "Friction",
    "GnssFloat",
    "GnssLatency",
    "GnssLoss",
    "Payload",
    "Script",
    "ScriptState",
    "Scripted",
    "SideForce",
    "SoftTyre",
    "SteeringPotBias",
    "SteeringPotStuck",
    "ValveWear",
    "clashes",
    "loadings",
]
