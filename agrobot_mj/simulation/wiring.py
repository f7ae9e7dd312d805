"""Lines from the tractor's computer to the valves, which faults may distort; the cut of power has a line of its own."""

from math import isnan
from typing import NamedTuple

from agrobot_mj.core.lines import SignalLine
from agrobot_mj.core.signals import NEUTRAL_V, SOUND, Conditions, Distortion, Drive


class Wiring(NamedTuple):
    """Both lines between two ticks; they carry voltages from neutral [V]."""

    steer: SignalLine = SignalLine(0.0)
    """Line to the steering valve."""
    pedal: SignalLine = SignalLine(0.0)
    """Line to the pedal valve."""

    def carried(self, drive: Drive, conditions: Conditions, dt: float) -> "tuple[Wiring, Drive]":
        """The lines after a tick of length `dt` [s], and the voltages that arrive."""
        if conditions.valve == conditions.pedal_valve == SOUND:
            return Wiring(
                SignalLine(drive.steer_voltage - NEUTRAL_V), SignalLine(drive.pedal_voltage - NEUTRAL_V)
            ), drive
        steer, steer_voltage = _carried(self.steer, drive.steer_voltage, conditions.valve, dt)
        pedal, pedal_voltage = _carried(self.pedal, drive.pedal_voltage, conditions.pedal_valve, dt)
        return Wiring(steer, pedal), drive._replace(steer_voltage=steer_voltage, pedal_voltage=pedal_voltage)


def _carried(line: SignalLine, voltage: float, distortion: Distortion, dt: float) -> tuple[SignalLine, float]:
    """The line and the voltage that arrives, within the range of a valve; without power it stays without."""
    line, arrived = line.carried(voltage - NEUTRAL_V, distortion, dt)
    return line, arrived if isnan(arrived) else NEUTRAL_V + min(max(arrived, -NEUTRAL_V), NEUTRAL_V)
