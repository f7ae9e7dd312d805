"""Faults of the steering potentiometer and of the valve, individually and in the closed loop."""

from math import degrees, radians

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S
from agrobot_mj.faults import Script, SteeringPotBias, ValveWear
from agrobot_mj.machine.hydraulics import LITRE_PER_MINUTE, Valve, static_flow, valve_law, worn_valve


def day(fault, t):
    script = Script((fault,), 1)
    return script.update(script.init(), t, TICK_S)[1]


def driven(*tables, name="circle", seconds=20.0, **overrides):
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    return run(load_scenario(name, {"plant.kind": "bicycle", "duration_s": seconds, "fault": list(tables), **keys}))


# --- potentiometer ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("t", "share"), [(10.0, 0.0), (12.0, 0.5), (14.0, 1.0), (60.0, 1.0)])
def test_ramped_fault_grows_linearly_to_its_full_size(t, share):
    bias = SteeringPotBias(start_s=10, bias_deg=-4.0, ramp_s=4.0)
    assert degrees(day(bias, t).steering_pot.offset) == pytest.approx(-4.0 * share)
    worn = day(ValveWear(start_s=10, gain_share=0.6, dead_band_v=0.8, ramp_s=4.0), t)
    assert (worn.valve_gain, worn.valve_dead_band) == pytest.approx((1 - 0.4 * share, 0.8 * share))


def test_steering_sensor_bias_steers_the_wheels_in_the_opposite_direction():
    """The loop controls the measured angle, so the wheel angle is wrong by the bias."""
    steer = {"controller": {"kind": "open_loop", "steer_deg": 10.0, "at_s": 0.0}, "seconds": 30.0}
    log = driven({"kind": "steering_pot_bias", "bias_deg": 3.0, "start_s": 5}, **steer)
    t = log.column("t")
    before, after = (t > 3) & (t < 5), t > 20
    for column, readings in (("steer", (10, 7)), ("steer_measured", (10, 10))):
        values = np.degrees(log.column(column))
        assert values[before].mean() == pytest.approx(readings[0], abs=0.3)
        assert values[after].mean() == pytest.approx(readings[1], abs=0.3)


def test_stuck_potentiometer_repeats_its_last_value_until_the_fault_ends():
    log = driven({"kind": "steering_pot_stuck", "start_s": 1, "end_s": 3}, seconds=4.0)
    measured = log.column("steer_measured")
    assert set(measured[20:60]) == {measured[19]}
    assert len(set(measured[:20])) == len(set(measured[60:])) == 20
    assert abs(log.column("steer")[59] - measured[59]) > radians(1.0), "the wheels go where they like"


def test_potentiometer_stuck_from_the_start_repeats_its_first_value():
    measured = driven({"kind": "steering_pot_stuck"}, seconds=2.0).column("steer_measured")
    assert set(measured) == {measured[0]}
    assert 0 < abs(measured[0]) < radians(1.0)


def test_potentiometer_that_becomes_stuck_keeps_its_current_bias():
    bias = {"kind": "steering_pot_bias", "bias_deg": 5.0, "start_s": 2}
    free, stuck = driven(bias, seconds=4.0), driven(bias, {"kind": "steering_pot_stuck", "start_s": 1}, seconds=4.0)
    assert stuck.column("steer_measured")[-1] == free.column("steer_measured")[19]


# --- valve --------------------------------------------------------------------------------------------------------


def test_worn_valve_has_less_flow_and_a_wider_dead_band():
    sound, _ = valve_law(Valve(), 0.002)
    tired = worn_valve(sound, 0.7, 0.4)
    edge = 0.4 + 0.4
    for sign, gain in ((1, 3.2), (-1, 2.8)):
        assert static_flow(tired, NEUTRAL_V + sign * (edge - 1e-9)) == 0.0
        flow = static_flow(tired, NEUTRAL_V + sign * (edge + 1.0))
        assert flow == pytest.approx(sign * 0.7 * gain * LITRE_PER_MINUTE)
    assert static_flow(tired, 12.0) == pytest.approx(0.7 * static_flow(sound, 12.0))
    assert worn_valve(sound, 1.0, 0.0) == sound


@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_steered_wheels_turn_more_slowly_with_a_worn_valve(plant):
    step = {"name": "step_steer", "controller__steer_deg": 30.0, "controller__at_s": 1.0, "plant__kind": plant}
    rates = []
    for tables in ([], [{"kind": "valve_wear", "gain_share": 0.5, "dead_band_v": 0.0}]):
        log = driven(*tables, seconds=3.0, **step)
        rates.append(np.diff(log.column("steer")).max() / TICK_S)
        assert np.abs(log.column("valve_flow")).max() == pytest.approx(
            (0.5 if tables else 1.0) * 12 * LITRE_PER_MINUTE, rel=1e-6
        )
    assert degrees(rates[0]) == pytest.approx(25.7, abs=1.0)
    assert rates[1] == pytest.approx(0.5 * rates[0], rel=0.03)


def test_steering_angle_stays_constant_without_oil_flow():
    log = driven({"kind": "valve_wear", "gain_share": 0.0, "start_s": 8.0}, seconds=12.0)
    steer = log.column("steer")
    assert abs(steer[160]) > radians(2.0)
    assert np.ptp(steer[161:]) == 0.0


def test_wider_valve_dead_band_increases_steering_oscillation():
    wear = {"kind": "valve_wear", "gain_share": 1.0, "dead_band_v": 2.0, "start_s": 10, "ramp_s": 40}
    log = driven(wear, name="straight_line", seconds=60.0, gains="paper")  # others answer the noise of the fixes
    error, t = np.degrees(log.column("steer_ref") - log.column("steer")), log.column("t")
    sound, worn = error[(t > 5) & (t < 10)], error[t > 50]
    assert worn.std() > 1.5 * sound.std()
