"""GNSS solutions arrive late: a slow radio link, a busy receiver."""

from typing import Literal

from agrobot_mj.core.signals import Conditions
from agrobot_mj.core.spec import Latency
from agrobot_mj.faults.base import Scripted


class GnssLatency(Scripted):
    """Solutions arrive later than usual.

    Nothing arrives while the latency sets in; when it ends, the solutions that newer ones have overtaken are lost.
    """

    kind: Literal["gnss_latency"] = "gnss_latency"
    latency_s: Latency = 0.2
    """Latency on top of the receiver's own, whole ticks [s]. Estimate (0.1-0.5 over a radio link)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Delay what is delivered."""
        return None, conditions._replace(gnss_latency_s=conditions.gnss_latency_s + self.latency_s)
