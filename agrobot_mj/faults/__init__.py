"""Scripted faults and disturbances: one file a kind, each changing the `Conditions` of a tick in its window."""

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from agrobot_mj.faults.base import Scripted
from agrobot_mj.faults.friction import Friction
from agrobot_mj.faults.gnss_float import GnssFloat
from agrobot_mj.faults.gnss_latency import GnssLatency
from agrobot_mj.faults.gnss_loss import GnssLoss
from agrobot_mj.faults.steering_pot_bias import SteeringPotBias
from agrobot_mj.faults.steering_pot_stuck import SteeringPotStuck
from agrobot_mj.faults.valve_wear import ValveWear
from agrobot_mj.randomness import stream
from agrobot_mj.signals import GOOD_DAY, Conditions

Fault = Annotated[
    Friction
    | GnssFloat
    | GnssLatency
    | GnssLoss
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
        found = GOOD_DAY
        for k, fault in enumerate(self.faults):
            if fault.active(t):
                self.states[k], found = fault.apply(self.states[k], found, t, dt)
        return found


def clashes(faults: Sequence[Scripted]) -> list[str]:
    """What is wrong between the faults of a scenario, each beginning with the key of the later one."""
    found = []
    for k, fault in enumerate(faults):
        for earlier in range(k):
            other = faults[earlier]
            if fault.subject == other.subject and fault.overlaps(other):
                found.append(
                    f"fault[{k}]: overlaps fault[{earlier}], both {fault.kind} "
                    f"({_window(fault)} and {_window(other)}); let one end before the other begins"
                )
    return found


def _window(fault: Scripted) -> str:
    return f"{fault.start_s:g} to {'the end' if fault.end_s is None else f'{fault.end_s:g} s'}"


__all__ = [
    "Fault",
    "Friction",
    "GnssFloat",
    "GnssLatency",
    "GnssLoss",
    "Script",
    "Scripted",
    "SteeringPotBias",
    "SteeringPotStuck",
    "ValveWear",
    "clashes",
]
