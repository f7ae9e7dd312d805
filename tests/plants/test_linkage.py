"""Steering linkage: kingpin axes, crossing of the play at each reversal, and a sensor on one knuckle."""

from math import atan2, degrees, radians, tan

import numpy as np
import pytest

from agrobot_mj import Simulation
from agrobot_mj.core.signals import NEUTRAL_V, NOMINAL, Drive, Reference
from agrobot_mj.machine import Linkage, Machine, Valve
from agrobot_mj.plants import Bicycle, BicyclePlant, Mujoco, MujocoPlant
from agrobot_mj.sensors import Sensors, SteeringPotentiometer
from agrobot_mj.terrain import Flat
from agrobot_mj.tyres import MagicFormula

ORIGIN = Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
SMOOTH = MagicFormula(patch_half_length_m=0.0, trail_m=0.0)


def plant_of(kind, linkage, valve=None, tyre=SMOOTH):
    machine = Machine(valve=valve or Valve(delay_s=0.0, time_constant_s=0.01), linkage=linkage)
    ground = Flat(half_size_m=50).ground()
    return (
        BicyclePlant(Bicycle(), machine, ground)
        if kind == "bicycle"
        else MujocoPlant(Mujoco(tyre=tyre), machine, ground)
    )


def steered(plant, volts, ticks):
    """Return the steering angle after a number of ticks [deg]."""
    for _ in range(ticks):
        truth = plant.advance(Drive(NEUTRAL_V + volts, NEUTRAL_V))
    return degrees(truth.steer)


def test_kingpin_axis_meets_the_ground_inside_and_ahead_of_the_wheel():
    linkage = Linkage(kingpin_offset_m=0.05, kingpin_inclination_deg=8.0, caster_deg=4.0)
    for side in (1, -1):
        foot, axis = np.array(linkage.foot(side, 0.27)), np.array(linkage.axis(side))
        assert foot == pytest.approx([0.27 * tan(radians(4.0)), -side * 0.05, -0.27])
        at_hub = foot + axis * 0.27  # at the height of the wheel's centre
        assert at_hub[0] == pytest.approx(0.0, abs=1e-12)
        assert at_hub[2] == pytest.approx(0.0, abs=1e-12)
        assert -side * at_hub[1] == pytest.approx(0.05 + 0.27 * tan(radians(8.0)))


@pytest.mark.parametrize("kind", ["bicycle", "mujoco"])
def test_wheel_angle_after_a_steering_reversal_lags_by_the_backlash(kind):
    """After steering left, then right, the wheel angle lags by a play of 2 deg; friction prevents coasting."""
    backlash, found = 2.0, {}
    for play in (0.0, backlash):
        plant = plant_of(kind, Linkage(backlash_deg=play, friction_n_m=100.0))
        plant.reset(ORIGIN)
        steered(plant, 2.0, 20)
        out = steered(plant, 0.0, 20)
        steered(plant, -2.2, 10)
        found[play] = out - steered(plant, 0.0, 20)
    assert found[0.0] - found[backlash] == pytest.approx(backlash, abs=0.1)


def test_pressure_and_wheel_motion_are_zero_inside_the_backlash():
    plant = plant_of("mujoco", Linkage(backlash_deg=4.0, friction_n_m=20.0))
    plant.reset(ORIGIN)
    steered(plant, 2.0, 20)
    out = steered(plant, 0.0, 20)
    steered(plant, -1.2, 3)
    inside = steered(plant, 0.0, 10)
    assert inside == pytest.approx(out, abs=0.15)
    assert abs(plant.actuation()[1]) < 1e3


def test_wheel_angle_with_backlash_follows_its_definition_in_both_plants():
    """By definition, the wheel is at rest unless its distance from the cylinder exceeds half the play."""
    plant, half = plant_of("bicycle", Linkage(backlash_deg=3.0)), radians(1.5)
    plant.reset(ORIGIN)
    delta = 0.0
    for k in range(120):
        plant.advance(Drive(NEUTRAL_V + 2.0 * np.sin(0.2 * k), NEUTRAL_V))
        oil = plant.state[7]
        assert abs(plant.state[5] - oil) <= half + 1e-12
        if abs(delta - oil) < half:
            assert abs(plant.state[5] - delta) < 0.02  # no more than the cylinder has moved
        delta = plant.state[5]
    assert delta != 0.0


@pytest.mark.parametrize("kind", ["bicycle", "mujoco"])
def test_run_restored_inside_the_backlash_continues_identically(kind):
    changes = {"plant.kind": kind, "steering.linkage.backlash_deg": 1.5, "duration_s": 4.0}
    sim = Simulation("figure_eight", changes)
    sim.reset()
    for _ in range(40):
        sim.step()
    saved, found = sim.save(), []
    for _ in range(2):
        sim.restore(saved)
        for _ in range(39):
            sim.step()
        found.append(sim.truth.steer)
    assert found[0] == found[1]


def test_steering_knuckles_follow_ackermann_geometry():
    for kind in ("bicycle", "mujoco"):
        plant = plant_of(kind, Linkage())
        plant.reset(ORIGIN)
        steered(plant, 3.0, 30)
        truth = plant.advance(Drive(NEUTRAL_V, NEUTRAL_V))
        share = 1.0 / 2.8  # track over twice the wheelbase
        for side, angle in zip((1, -1), truth.knuckle_samples[:, -1], strict=True):
            exact = atan2(tan(truth.steer), 1 - side * share * tan(truth.steer))
            assert degrees(angle) == pytest.approx(degrees(exact), abs=0.5 if kind == "mujoco" else 1e-9)
        assert truth.knuckle_samples[0, -1] > truth.steer > truth.knuckle_samples[1, -1] > 0.1


@pytest.mark.parametrize("side", ["left", "right"])
def test_knuckle_sensor_measures_one_wheel_with_its_own_calibration(side):
    fine = {"resolution_deg": 1e-6, "noise_sigma_deg": 0.0}
    plant = plant_of("bicycle", Linkage())
    plant.reset(ORIGIN)
    steered(plant, 3.0, 30)
    for _ in range(2):
        truth = plant.advance(Drive(NEUTRAL_V, NEUTRAL_V))
    wheel = degrees(truth.knuckle_samples[0 if side == "left" else 1, -1])
    straight, bent = (
        SteeringPotentiometer(at=side, **fine, **more)
        for more in ({}, {"second_order_deg": 2.0, "third_order_deg": -3.0})
    )
    readings = []
    for pot in (straight, bent):
        _, measured = Sensors(steering_pot=pot).measure(Sensors(steering_pot=pot).init(1), truth, NOMINAL, 0.05)
        readings.append(degrees(measured.steer))
    assert readings[0] == pytest.approx(wheel, abs=0.02)
    assert readings[1] - readings[0] == pytest.approx(2.0 * (wheel / 45) ** 2 - 3.0 * (wheel / 45) ** 3, abs=0.02)


def test_potentiometer_has_a_separate_scale_on_each_side_of_its_centre():
    pot = SteeringPotentiometer(centre_deg=2.0, scale_left=0.8, scale_right=1.25)
    seen = np.degrees(pot.characteristic(np.radians([-20.0, 0.0, 10.0])))
    assert seen == pytest.approx([-23.0, 2.0, 10.0])
