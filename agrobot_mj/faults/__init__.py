"""Scripted faults and disturbances: a file per kind, or per effect on lines, each changing a tick's `Conditions`."""

from typing import Annotated

from pydantic import Field

from agrobot_mj.faults.base import Scripted
from agrobot_mj.faults.bias import GyroBias, HeadingBias, PedalPotBias, SteeringPotBias
from agrobot_mj.faults.delay import PedalValveDelay, ValveDelay
from agrobot_mj.faults.drawbar import Drawbar
from agrobot_mj.faults.friction import Friction
from agrobot_mj.faults.gnss_drift import GnssDrift
from agrobot_mj.faults.gnss_float import GnssFloat
from agrobot_mj.faults.gnss_frozen import GnssFrozen
from agrobot_mj.faults.gnss_jump import GnssJump
from agrobot_mj.faults.gnss_latency import GnssLatency
from agrobot_mj.faults.gnss_loss import GnssLoss
from agrobot_mj.faults.loss import GyroLoss, HeadingLoss, WheelSpeedLoss
from agrobot_mj.faults.payload import Payload
from agrobot_mj.faults.scale import (
    GyroScale,
    PedalPotScale,
    PedalValveScale,
    SteeringPotScale,
    ValveScale,
    WheelSpeedScale,
)
from agrobot_mj.faults.script import Script, ScriptState, clashes, loadings
from agrobot_mj.faults.side_force import SideForce
from agrobot_mj.faults.soft_tyre import SoftTyre
from agrobot_mj.faults.stuck import (
    GyroStuck,
    HeadingStuck,
    PedalPotStuck,
    PedalValveStuck,
    SteeringPotStuck,
    ValveStuck,
    WheelSpeedStuck,
)
from agrobot_mj.faults.valve_wear import ValveWear

Fault = Annotated[
    Drawbar
    | Friction
    | GnssDrift
    | GnssFloat
    | GnssFrozen
    | GnssJump
    | GnssLatency
    | GnssLoss
    | GyroBias
    | GyroLoss
    | GyroScale
    | GyroStuck
    | HeadingBias
    | HeadingLoss
    | HeadingStuck
    | Payload
    | PedalPotBias
    | PedalPotScale
    | PedalPotStuck
    | PedalValveDelay
    | PedalValveScale
    | PedalValveStuck
    | SideForce
    | SoftTyre
    | SteeringPotBias
    | SteeringPotScale
    | SteeringPotStuck
    | ValveDelay
    | ValveScale
    | ValveStuck
    | ValveWear
    | WheelSpeedLoss
    | WheelSpeedScale
    | WheelSpeedStuck,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = [
    "Drawbar",
    "Fault",
    "Friction",
    "GnssDrift",
    "GnssFloat",
    "GnssFrozen",
    "GnssJump",
    "GnssLatency",
    "GnssLoss",
    "GyroBias",
    "GyroLoss",
    "GyroScale",
    "GyroStuck",
    "HeadingBias",
    "HeadingLoss",
    "HeadingStuck",
    "Payload",
    "PedalPotBias",
    "PedalPotScale",
    "PedalPotStuck",
    "PedalValveDelay",
    "PedalValveScale",
    "PedalValveStuck",
    "Script",
    "ScriptState",
    "Scripted",
    "SideForce",
    "SoftTyre",
    "SteeringPotBias",
    "SteeringPotScale",
    "SteeringPotStuck",
    "ValveDelay",
    "ValveScale",
    "ValveStuck",
    "ValveWear",
    "WheelSpeedLoss",
    "WheelSpeedScale",
    "WheelSpeedStuck",
    "clashes",
    "loadings",
]
