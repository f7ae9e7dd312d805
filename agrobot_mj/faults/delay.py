"""Valves that answer late: a loaded bus, cold oil, a sticking pilot."""

from typing import Literal

from agrobot_mj.core.signals import Conditions
from agrobot_mj.core.spec import Latency
from agrobot_mj.faults.line import LineFault


class Delayed(LineFault):
    """A signal that arrives late; while the delay sets in the last value stays."""

    delay_s: Latency = 0.5
    """Delay on top of the valve's own, whole ticks [s]. Estimate (0.2-1)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Delay the signal."""
        delay = self.distortion(conditions).delay_s + self.delay_s
        return None, self.distorted(conditions, delay_s=delay)


class ValveDelay(Delayed):
    """The steering valve answers late."""

    kind: Literal["valve_delay"] = "valve_delay"


class PedalValveDelay(Delayed):
    """The pedal valve answers late."""

    kind: Literal["pedal_valve_delay"] = "pedal_valve_delay"
