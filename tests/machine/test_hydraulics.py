"""Steering valve and cylinder: dead band, gains, saturation, delay, lag, and derived quantities."""

from math import degrees, exp, pi

import numpy as np
import pytest

from agrobot_mj.machine.hydraulics import (
    LITRE_PER_MINUTE,
    NEUTRAL_V,
    Cylinder,
    Valve,
    beyond_play,
    loaded_flow,
    static_flow,
    valve_law,
    valve_step,
    worn_valve,
)
from agrobot_mj.machine.tractor import TractorParameters

DT, TRACTOR = 0.002, TractorParameters()


def flow_at(voltage, **changes):
    """Return the flow after two seconds at a voltage [l/min]."""
    law, memory = valve_law(Valve(**changes), DT)
    for _ in range(1000):
        flow = valve_step(law, memory, voltage)
    return flow / LITRE_PER_MINUTE


def spool_response(valve, voltages, dt=DT):
    """Return the spool voltage after each step."""
    law, memory = valve_law(valve, dt)
    return np.array([(valve_step(law, memory, v), memory.spool[0])[1] for v in voltages])


@pytest.mark.parametrize("voltage", [5.6, 5.8, 6.0, 6.2, 6.399])
def test_oil_flow_is_zero_inside_the_dead_band(voltage):
    assert flow_at(voltage) == 0.0


@pytest.mark.parametrize(("voltage", "flow"), [(6.5, 0.32), (7.4, 3.2), (5.5, -0.28), (4.6, -2.8)])
def test_flow_outside_the_dead_band_has_a_separate_gain_per_direction(voltage, flow):
    assert flow_at(voltage) == pytest.approx(flow, rel=1e-6)


@pytest.mark.parametrize(
    ("voltage", "flow"), [(12.0, 12.0), (10.2, 12.0), (0.0, -12.0), (1.2, -12.0), (99.0, 12.0), (-99.0, -12.0)]
)
def test_valve_flow_saturates_at_the_pump_flow(voltage, flow):
    assert flow_at(voltage) == pytest.approx(flow, rel=1e-9)


def test_valve_voltage_is_clipped_before_the_spool_dynamics():
    spool = spool_response(Valve(delay_s=0.0), [1e6] * 5000)
    assert spool.max() <= 12.0
    assert spool[-1] == pytest.approx(12.0)
    assert spool_response(Valve(delay_s=0.0), [-1e6] * 5000).min() >= 0.0


def test_flow_over_voltage_is_continuous_and_monotonic():
    law, _ = valve_law(Valve(), DT)
    flows = np.array([static_flow(law, v) for v in np.linspace(0, 12, 12001)])
    steepest = 3.2 * LITRE_PER_MINUTE * 0.001
    assert (np.diff(flows) >= 0).all()
    assert np.diff(flows).max() <= steepest * (1 + 1e-6)
    assert flows[-1] == pytest.approx(-flows[0]) == pytest.approx(12 * LITRE_PER_MINUTE)


@pytest.mark.parametrize(
    ("delay_s", "dt", "steps"),
    [(0.1, 0.002, 50), (0.1, 0.004, 25), (0.1, 0.005, 20), (0.0, 0.002, 0), (0.25, 0.001, 250)],
)
def test_valve_delay_is_rounded_to_a_whole_number_of_steps(delay_s, dt, steps):
    spool = spool_response(Valve(delay_s=delay_s), [9.0] * (steps + 3), dt)
    assert np.flatnonzero(spool > NEUTRAL_V)[0] == steps


def test_delayed_voltages_keep_their_order():
    voltages = np.random.default_rng(2).uniform(0, 12, 400)
    fast = Valve(delay_s=0.1, time_constant_s=1e-9)
    assert spool_response(fast, voltages)[50:] == pytest.approx(voltages[:-50])


@pytest.mark.parametrize("dt", [0.001, 0.002, 0.005])
def test_spool_reaches_63_percent_of_a_step_after_its_time_constant(dt):
    spool = spool_response(Valve(delay_s=0.0, time_constant_s=0.15), [10.0] * 400, dt)
    share = (spool - NEUTRAL_V) / 4.0
    times = dt * np.arange(1, 401)
    assert share == pytest.approx(1 - np.exp(-times / 0.15), abs=1e-9)
    assert np.interp(0.15, times, share) == pytest.approx(1 - exp(-1), abs=1e-4)


def test_neutral_voltage_gives_no_flow():
    law, memory = valve_law(Valve(), DT)
    assert not any(valve_step(law, memory, NEUTRAL_V) for _ in range(200))


def test_steering_cylinder_area_and_torque_match_hand_calculation():
    cylinder = Cylinder(bore_mm=60, rod_mm=30, arm_m=0.2, relief_pressure_bar=120)
    head, rod = pi / 4 * 0.06**2, pi / 4 * (0.06**2 - 0.03**2)
    assert cylinder.area == pytest.approx((head + rod) / 2)
    assert cylinder.displacement == pytest.approx(cylinder.area * 0.2)
    assert cylinder.column(TRACTOR).relief_torque == pytest.approx(120e5 * cylinder.area * 0.2)


def test_default_steering_rate_lies_in_the_published_range():
    rate = degrees(12 * LITRE_PER_MINUTE / Cylinder().displacement)
    assert 15 <= rate <= 30


@pytest.mark.parametrize(
    ("changes", "largest"),
    [
        ({}, 12.0),
        ({"engine_speed_share": 0.4}, 4.8),
        ({"section_flow_l_min": 5.0}, 5.0),
        ({"section_flow_l_min": 5.0, "engine_speed_share": 0.4}, 4.8),
        ({"other_flow_l_min": 8.0}, 12.0),
        ({"other_flow_l_min": 8.0, "priority": False}, 4.0),
        ({"other_flow_l_min": 20.0, "priority": False}, 0.0),
        ({"other_flow_l_min": 3.0, "priority": False, "engine_speed_share": 0.5}, 3.0),
    ],
)
def test_maximum_flow_is_limited_by_valve_section_and_other_consumers(changes, largest):
    law, _ = valve_law(Valve(**changes), DT)
    assert static_flow(law, 12.0) == pytest.approx(largest * LITRE_PER_MINUTE)
    assert static_flow(law, 0.0) == pytest.approx(-largest * LITRE_PER_MINUTE)


def test_flow_of_uncompensated_valve_follows_the_orifice_equation():
    """Flow is proportional to the root of the pressure difference: 71 % with half of the supply pressure opposing, 0
    with all of it."""
    law, _ = valve_law(Valve(supply_pressure_bar=100.0), DT)
    flow = 0.3 * law.saturation
    assert loaded_flow(law, flow, 0.0) == flow
    assert loaded_flow(law, flow, 50e5) == pytest.approx(flow * 0.5**0.5)
    assert loaded_flow(law, -flow, 50e5) == pytest.approx(-flow * 1.5**0.5)
    assert loaded_flow(law, flow, 100e5) == 0.0
    assert loaded_flow(law, flow, 150e5) == 0.0
    assert loaded_flow(law, law.saturation, -100e5) == law.saturation


def test_flow_of_compensated_valve_is_independent_of_the_load():
    law, _ = valve_law(Valve(), DT)
    assert loaded_flow(law, 1e-4, 90e5) == 1e-4


@pytest.mark.parametrize(("deflection", "left"), [(0.0, 0.0), (0.9, 0.0), (-0.9, 0.0), (1.5, 0.5), (-1.5, -0.5)])
def test_deflections_up_to_half_of_the_backlash_have_no_effect(deflection, left):
    assert beyond_play(deflection, 1.0) == left


@pytest.mark.parametrize(
    ("voltage", "flow"), [(8.0, 1.3 * 1.6), (4.0, -1.3 * 1.4), (12.0, 6.0), (0.0, -6.0), (6.6, 0.0)]
)
def test_worn_valve_has_less_flow_and_a_wider_dead_band(voltage, flow):
    """Gains are half of 3.2 and 2.8 l/(min V) beyond a dead band of 0.7 V, and the maximum is half of 12 l/min."""
    law, _ = valve_law(Valve(), DT)
    found = static_flow(worn_valve(law, 0.5, 0.3), voltage) / LITRE_PER_MINUTE
    assert found == pytest.approx(flow)
    assert worn_valve(law, 1.0, 0.0) == law
