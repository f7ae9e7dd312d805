"""Wheel loads on side slopes up to the tipping slope of the data sheet."""

import numpy as np
import pytest

from agrobot_mj.core.signals import Reference
from agrobot_mj.extensions.bench.manoeuvres.tipping import GRIPPING, tilt
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import Flat, Slope
from agrobot_mj.tyres.patch import LOAD


def across(machine, grade_deg):
    """Return the plant of a machine without an implement after its start across a slope with high friction."""
    terrain = Slope(grade_deg=grade_deg, direction_deg=-90.0) if grade_deg else Flat()
    ground = terrain.ground()._replace(surface=GRIPPING)
    scenario = load_scenario("straight_line", {"machine": machine, "implement": {"kind": "none"}})
    plant = MujocoPlant(scenario.plant, scenario.vehicle, ground)
    plant.reset(Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    return plant


VINEYARD = """
[tractor]
wheelbase_m = 1.7
mass_kg = 1250
track_m = 0.95
cg_height_m = 0.7
front_load_fraction = 0.4
front_wheel_radius_m = 0.33
rear_wheel_radius_m = 0.5
"""
CARRIER = """
[tractor]
wheelbase_m = 1.1
mass_kg = 420
track_m = 0.8
cg_height_m = 0.6
front_load_fraction = 0.5
front_wheel_radius_m = 0.3
rear_wheel_radius_m = 0.3
front_wheel_mass_kg = 9
rear_wheel_mass_kg = 9
"""
HEAVY = """
[tractor]
wheelbase_m = 3.05
mass_kg = 12400
track_m = 2.05
cg_height_m = 1.35
front_load_fraction = 0.4
front_wheel_radius_m = 0.8
rear_wheel_radius_m = 1.03
front_wheel_mass_kg = 260
rear_wheel_mass_kg = 600
"""


@pytest.mark.parametrize("keys", [VINEYARD, CARRIER, HEAVY], ids=["vineyard", "carrier", "heavy"])
def test_wheels_stay_loaded_up_to_the_tipping_slope_of_the_data_sheet(keys, tmp_path, capsys):
    file = tmp_path / "own.toml"
    file.write_text(keys)
    tips = tilt(across(str(file), 0.0), False, 60.0, 0.1).lifted_deg
    below = across(str(file), tips - 0.25)
    assert below.trouble() is None
    assert below.wheels().reshape(-1, 4)[LOAD].min() > 0.0
    assert capsys.readouterr().err == ""
    above = across(str(file), tips + 0.25)
    assert above.wheels().reshape(-1, 4)[LOAD].min() == 0.0
    assert f"{tips + 0.25:.1f} deg" in capsys.readouterr().err


def test_wheel_loads_on_a_steep_side_slope_agree_with_statics():
    plant = across("utility", 25.0)
    loads, p = plant.wheels().reshape(-1, 4)[LOAD], plant.tractor
    assert loads.sum() == pytest.approx(p.mass_kg * GRAVITY * np.cos(np.radians(25.0)), rel=2e-3)
    rear = p.rear_wheel
    yields = rear.deflection / 0.45  # side deflection of the carcass on a slope of 45 deg
    leans = (loads[2] - loads[3]) / rear.stiffness / p.track_m * p.cg_height_m  # of the CG, by the roll on the tyres
    lower = 0.5 + ((p.cg_height_m + yields) * np.tan(np.radians(25.0)) + leans) / p.track_m
    assert loads[[0, 2]].sum() / loads.sum() == pytest.approx(lower, abs=0.02)
