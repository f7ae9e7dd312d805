"""Scripted faults and disturbances: one file a kind, each changing the `Conditions` of a tick in its window."""

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import NOMINAL, Conditions, PointMass
from agrobot_mj.faults.base import Scripted
from agrobot_mj.faults.drawbar import Drawbar
from agrobot_mj.faults.friction import Friction
from agrobot_mj.faults.gnss_float import GnssFloat
from agrobot_mj.faults.gnss_latency import GnssLatency
from agrobot_mj.faults.gnss_loss import GnssLoss
from agrobot_mj.faults.payload import Payload
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


class Script:
    """The faults of a run and what they remember."""

    def __init__(self, faults: Sequence[Scripted], seed: int) -> None:
        self.faults = tuple(faults)
        self.states: list[Any] = [
            fault.init(stream(seed, f"fault.{fault.subject}.{fault.start_s}")) for fault in self.faults
        ]

    def active(self, t: float) -> int:
        """How many faults act at `t` [s]."""
        return sum(fault.active(t) for fault in self.faults)

    def conditions(self, t: float, dt: float) -> Conditions:
        """Of the tick of length `dt` [s] that begins at `t` [s]; to be asked once a tick, in order."""
        found = NOMINAL
        for k, fault in enumerate(self.faults):
            if fault.active(t):
                self.states[k], found = fault.apply(self.states[k], found, t, dt)
        return found


def clashes(faults: Sequence[Scripted]) -> list[str]:
    """What is wrong between the faults of a scenario, each beginning with the key of the later one."""
    found = []
    earlier: dict[str, list[int]] = {}
    for k, fault in enumerate(faults):
        alike = earlier.setdefault(fault.subject, [])
        if (first := next((i for i in alike if fault.overlaps(faults[i])), None)) is not None:
            found.append(
                f"fault[{k}]: overlaps fault[{first}], both {fault.kind} "
                f"({_window(fault)} and {_window(faults[first])}); let one end before the other begins"
            )
        alike.append(k)
    return found


def loadings(faults: Sequence[Scripted]) -> list[tuple[int, tuple[PointMass, ...]]]:
    """Every payload that the tractor ever carries, each with the index of the fault whose begin or end brings it."""
    found = []
    for k, fault in enumerate(faults):
        if isinstance(fault, Payload):
            times = (fault.start_s,) if fault.end_s is None else (fault.start_s, fault.end_s)
            found += [(k, tuple(f.load for f in faults if isinstance(f, Payload) and f.active(t))) for t in times]
    return found


def _window(fault: Scripted) -> str:
    return f"{fault.start_s:g} to {'the end' if fault.end_s is None else f'{fault.end_s:g} s'}"


__all__ = [
    "Drawbar",
    "Fault",
    "Friction",
    "GnssFloat",
    "GnssLatency",
    "GnssLoss",
    "Payload",
    "Script",
    "Scripted",
    "SideForce",
    "SoftTyre",
    "SteeringPotBias",
    "SteeringPotStuck",
    "ValveWear",
    "clashes",
    "loadings",
]
