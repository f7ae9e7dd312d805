"""Tip-over angles against statics that include the roll on the tyres, the side deflection of the carcass, the pivot."""

from math import atan, cos, degrees, radians, sin

import pytest
from scipy.optimize import brentq

from agrobot_mj.extensions.bench.manoeuvres.theory import parts
from agrobot_mj.extensions.bench.manoeuvres.tipping import GRIPPING, tilt
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.driver import ORIGIN
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import Flat

CARCASS = 0.45
"""Lateral stiffness of the carcass divided by the vertical one."""


def scenario_of(machine, **keys):
    """A bare machine on tyres of the magic formula."""
    fixed = {"machine": machine, "implement": {"kind": "none"}}
    return load_scenario("straight_line", fixed | {key.replace("__", "."): value for key, value in keys.items()})


def tipping(scenario):
    """Slope at which the upper rear wheel leaves the ground in the simulator [deg]."""
    plant = MujocoPlant(scenario.plant, scenario.vehicle, Flat().ground()._replace(surface=GRIPPING))
    plant.reset(ORIGIN)
    return tilt(plant, True, 60.0).lifted_deg


def static(tractor, follows):
    """The same from moments of the body about the line through the pivot and the middle of the rear patches [deg]."""
    body, L, T, k = parts(tractor), tractor.wheelbase_m, tractor.track_m, tractor.rear_wheel.stiffness

    def righting(deg):
        across, down = GRAVITY * sin(radians(deg)), GRAVITY * cos(radians(deg))
        on_rear = tractor.mass_kg * (1 - tractor.front_load_fraction)
        rise = on_rear * (GRAVITY - down) / (2 * k)
        aside = on_rear * across / (CARCASS * k) if follows else 0.0
        arm = body.body_z - body.pivot_z * body.body_x / L + rise * (1 - body.body_x / L)
        lean = on_rear * down / (k * T)
        return on_rear * down * (T / 2 - aside) - body.body_kg * arm * (across + down * lean)

    return brentq(righting, 1.0, 60.0)


@pytest.mark.parametrize("machine", ["compact", "orchard", "row_crop"])
def test_tip_angle_with_a_yielding_carcass_is_that_of_statics(machine):
    scenario = scenario_of(machine, plant__tyre__load_follows_carcass=True)
    wanted, plain = (static(scenario.tractor, follows) for follows in (True, False))
    assert tipping(scenario) == pytest.approx(wanted, abs=0.3)
    assert plain - wanted > 1.5


@pytest.mark.parametrize("radii", [-0.2, 0.6])
def test_tip_angle_follows_the_height_of_the_pivot(radii):
    """A high pivot steepens the line about which the tractor tips."""
    changed, usual = scenario_of("utility", tractor__axle_pivot_radii=radii), scenario_of("utility")
    assert tipping(changed) == pytest.approx(static(changed.tractor, False), abs=0.3)
    assert abs(static(changed.tractor, False) - static(usual.tractor, False)) > 1.0


def test_pivot_is_at_the_same_share_of_every_front_wheel():
    for machine in ("compact", "row_crop"):
        tractor = scenario_of(machine, tractor__axle_pivot_radii=0.3).tractor
        wheel = tractor.front_wheel
        above = parts(tractor).pivot_z - (wheel.radius - wheel.deflection)
        assert above == pytest.approx(0.3 * wheel.radius, abs=1e-3)


def test_without_a_carcass_statics_tend_to_the_rigid_angle():
    stiff = scenario_of("compact").tractor.model_copy(update={"rear_tyre_stiffness_n_m": 1e9})
    b, L = parts(stiff), stiff.wheelbase_m
    rigid = atan(stiff.track_m / 2 * (L - b.body_x) / (L * b.body_z - b.pivot_z * b.body_x))
    whole = stiff.mass_kg * (1 - stiff.front_load_fraction) / (b.body_kg * (1 - b.body_x / L))
    assert static(stiff, True) == pytest.approx(degrees(rigid), abs=1.0 + 10 * abs(whole - 1))
