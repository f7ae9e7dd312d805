"""Signal lines, which transmit sensor signals or valve voltages with a `Distortion`.

A faulty line may lose, hold, delay, scale or offset its signal. At the start of a delay the line repeats the last
transmitted value. When the delay ends, the values in transit are lost.
"""

from math import nan
from typing import NamedTuple

from agrobot_mj.core.signals import SOUND, Distortion


class SignalLine(NamedTuple):
    """State of a signal line between two ticks: last received value and values in transit."""

    last: float | None = None  # Last value that arrived, or None before the first value
    pending: tuple[float, ...] = ()  # Values in transit, oldest first

    def transmit(self, value: float, distortion: Distortion, dt: float) -> "tuple[SignalLine, float]":
        """Return the line after a tick of `dt` [s], and the received value for the sent `value`. NaN is transmitted as
        NaN."""
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
