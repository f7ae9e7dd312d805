"""Signal lines from sensors and to valves, under a `Distortion`.

A line may be stuck, delayed, scaled or offset independent of its signal, so that one function covers all these faults.
When a delay starts the last value is repeated; when a delay ends the pending values are lost.
"""

from math import nan
from typing import NamedTuple

from agrobot_mj.core.signals import SOUND, Distortion


class SignalLine(NamedTuple):
    """State of a line between two ticks."""

    last: float | None = None
    """Last value that arrived; None before the first."""
    pending: tuple[float, ...] = ()
    """Values in transit, oldest first."""

    def carried(self, value: float, distortion: Distortion, dt: float) -> "tuple[SignalLine, float]":
        """Return the line after a tick of length `dt` [s], and the value that arrives for `value`; NaN (no signal)
        stays NaN."""
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
