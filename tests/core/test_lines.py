"""Signal lines of sensors and valves: received values for each distortion."""

from math import isnan, nan

from agrobot_mj.core.lines import SignalLine
from agrobot_mj.core.signals import NOMINAL, SOUND, Distortion, Drive
from agrobot_mj.simulation.loop import Wiring

DT = 0.05


def arrived(values, distortions):
    """Return the values received for the sent `values`, each with its distortion."""
    line, found = SignalLine(), []
    for value, distortion in zip(values, distortions, strict=True):
        line, value = line.transmit(value, distortion, DT)
        found.append(value)
    return found


def test_signal_line_without_fault_passes_values_unchanged():
    assert arrived([1.0, -2.0, 3.0], [SOUND] * 3) == [1.0, -2.0, 3.0]


def test_stuck_signal_line_repeats_its_last_value_or_gives_zero():
    values = [1.0, 2.0, 3.0, 4.0]
    assert arrived(values, [SOUND, *[Distortion(stuck="last")] * 2, SOUND]) == [1.0, 1.0, 1.0, 4.0]
    assert arrived(values, [SOUND, *[Distortion(stuck="zero")] * 2, SOUND]) == [1.0, 0.0, 0.0, 4.0]
    assert arrived(values, [Distortion(stuck="last")] * 4) == [1.0] * 4


def test_scale_fault_is_applied_before_offset_fault():
    assert arrived([2.0], [Distortion(scale=-1.0, offset=0.5)]) == [-1.5]


def test_delayed_signal_line_repeats_its_last_value_during_the_delay():
    late = Distortion(delay_s=2 * DT)
    assert arrived([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [SOUND, late, late, late, late, SOUND]) == [1, 1, 1, 2, 3, 6]


def test_lost_measurements_and_values_of_absent_sensors_are_nan():
    assert all(isnan(value) for value in arrived([1.0, 2.0], [Distortion(lost=True)] * 2))
    assert all(isnan(value) for value in arrived([nan, nan], [Distortion(stuck="zero"), Distortion(offset=1.0)]))


def test_signal_line_fault_does_not_restore_cut_valve_power():
    """The power cut is independent of line faults."""
    for distortion in (Distortion(stuck="last"), Distortion(scale=-1.0), Distortion(delay_s=0.5)):
        ill = NOMINAL._replace(pedal_valve=distortion)
        wiring, _ = Wiring().transmit(Drive(6.0, 9.0), ill, DT)
        assert isnan(wiring.transmit(Drive(6.0, nan), ill, DT)[1].pedal_voltage)


def test_distorted_valve_voltage_is_clipped_to_the_valid_range():
    ill = NOMINAL._replace(valve=Distortion(scale=10.0))
    assert Wiring().transmit(Drive(7.5, 6.0), ill, DT)[1].steer_voltage == 12.0
    assert Wiring().transmit(Drive(4.5, 6.0), ill, DT)[1].steer_voltage == 0.0
