"""Tip-over angles compared with statics, including roll on the tyres, carcass deflection and axle pivot."""

from math import atan, degrees

import pytest
from tipping_statics import tipping_deg

from agrobot_mj.core.resources import machine_files
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor, parts
from agrobot_mj.extensions.bench.manoeuvres.tipping import GRIPPING, tilt
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.driver import ORIGIN
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import Flat


def scenario_of(machine, **keys):
    """Return a scenario with a machine without an implement on tyres of the magic formula."""
    fixed = {"machine": machine, "implement": {"kind": "none"}}
    return load_scenario("straight_line", fixed | {key.replace("__", "."): value for key, value in keys.items()})


def tipping(scenario):
    """Return the slope at which the upper rear wheel leaves the ground in the simulator [deg]."""
    plant = MujocoPlant(scenario.plant, scenario.vehicle, Flat().ground()._replace(surface=GRIPPING))
    plant.reset(ORIGIN)
    return tilt(plant, True, 60.0).lifted_deg


@pytest.mark.parametrize("machine", sorted(machine_files()))
def test_tipping_angle_with_a_deflecting_carcass_agrees_with_statics(machine):
    scenario = scenario_of(machine)
    tractor, share = scenario.tractor, scenario.plant.tyre.carcass_lateral
    assert tipping(scenario) == pytest.approx(tipping_deg(tractor, True, share=share), abs=0.3)
    theory = Tractor(tractor, scenario.plant.tyre).tipping_deg
    assert theory == pytest.approx(tipping_deg(tractor, True, False, share), abs=0.05)
    assert 1.0 < tipping_deg(tractor, False) - tipping_deg(tractor, True, share=share) < 7.0


@pytest.mark.parametrize("machine", ["compact", "row_crop"])
def test_tipping_angle_with_load_in_the_wheel_plane_agrees_with_statics(machine):
    scenario = scenario_of(machine, plant__tyre__load_follows_carcass=False)
    assert tipping(scenario) == pytest.approx(
        tipping_deg(scenario.tractor, False, share=scenario.plant.tyre.carcass_lateral), abs=0.3
    )


@pytest.mark.parametrize("radii", [-0.2, 0.6])
def test_tipping_angle_depends_on_the_height_of_the_axle_pivot(radii):
    """A higher pivot increases the inclination of the line about which the tractor tips."""
    changed, usual = scenario_of("utility", tractor__axle_pivot_radii=radii), scenario_of("utility")
    assert tipping(changed) == pytest.approx(tipping_deg(changed.tractor, True), abs=0.3)
    assert abs(tipping_deg(changed.tractor, True) - tipping_deg(usual.tractor, True)) > 1.0


def test_axle_pivot_height_is_the_configured_fraction_of_the_wheel_radius():
    for machine in ("compact", "row_crop"):
        tractor = scenario_of(machine, tractor__axle_pivot_radii=0.3).tractor
        wheel = tractor.front_wheel
        above = parts(tractor).pivot_z - (wheel.radius - wheel.deflection)
        assert above == pytest.approx(0.3 * wheel.radius, abs=1e-3)


def test_tipping_angle_on_stiff_tyres_approaches_the_rigid_body_value():
    stiff = scenario_of("compact").tractor.model_copy(update={"rear_tyre_stiffness_n_m": 1e9})
    b, L = parts(stiff), stiff.wheelbase_m
    rigid = atan(stiff.track_m / 2 * (L - b.body_x) / (L * b.body_z - b.pivot_z * b.body_x))
    whole = stiff.mass_kg * (1 - stiff.front_load_fraction) / (b.body_kg * (1 - b.body_x / L))
    assert tipping_deg(stiff, True, hold=False) == pytest.approx(degrees(rigid), abs=1.0 + 10 * abs(whole - 1))
