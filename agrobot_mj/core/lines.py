"""Lines from sensors and to valves: what arrives of a signal under a `Distortion`.

A line is stuck, late, scaled or offset whatever it carries, so that a fault of any of them is this one function.
While a delay sets in the last value is repeated; what is under way when it ends is lost.
"""

from math import nan
from typing import NamedTuple

from agrobot_mj.core.signals import SOUND, Distortion


class SignalLine(NamedTuple):
    """A line between two ticks."""

    last: float | None = None
    """Value that arrived last; None before the first."""
    pending: tuple[float, ...] = ()
    """Values under way, oldest first."""

    def carried(self, value: float, distortion: Distortion, dt: float) -> "tuple[SignalLine, float]":
        """The line after a tick of length `dt` [s], and what arrives of `value`; NaN, no signal, stays NaN."""
        if distortion == SOUND or value != value:
            return SignalLine(value), value
        if distortion.lost:
            return self, nan
        if distortion.stuck:
            held = 0.0 if distortion.stuck == "zero" else value if self.last is None else self.last
            return SignalLine(held), held
        pending = (*self.pending, distortion.scale * value + distortion.offset)
        late = round(distortion.delay_s / dt)
        if len(pending) <= late:
            held = value if self.last is None else self.last
            return SignalLine(held, pending), held
        arrived = pending[-1 - late]
        return SignalLine(arrived, pending[len(pending) - late :]), arrived
