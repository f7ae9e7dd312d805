"""Random fields of soil strength, friction and moisture, and named surfaces."""

import numpy as np
import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.randomness import stream
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants import Clock, Mujoco, MujocoPlant
from agrobot_mj.plants.driver import Driver
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import Flat, Rough, surface_at
from agrobot_mj.terrain.grid import rolling_at
from agrobot_mj.terrain.shapes import CirclePatch
from agrobot_mj.terrain.variation import NAMED, Variation, gaussian_field
from agrobot_mj.tyres import MagicFormula, Soil

SEEDS = range(100)


def surface_of(**keys):
    return Flat(half_size_m=30.0, variation=Variation(correlation_m=4.0, cell_m=1.0, **keys)).ground().surface


def lag(fields, cells):
    """Return the mean product of values at a distance of `cells`, along rows and columns."""
    along, across = fields[:, :, :-cells] * fields[:, :, cells:], fields[:, :-cells] * fields[:, cells:]
    return (along.mean() + across.mean()) / 2


@pytest.mark.parametrize("cell", [0.125, 0.25, 0.5])
def test_soil_variance_and_correlation_equal_the_keys_over_100_seeds(cell):
    """The standard error of the variance is about 1 % on 20 correlation lengths."""
    cells = round(20 / cell)
    fields = np.array([gaussian_field(stream(seed, "test"), (cells, cells), cell) for seed in SEEDS])
    assert fields.mean() == pytest.approx(0.0, abs=0.04)
    assert fields.var() == pytest.approx(1.0, abs=0.04)
    for lengths in (0.5, 1.0, 2.0):
        assert lag(fields, round(lengths / cell)) == pytest.approx(np.exp(-lengths), abs=0.04)


def test_soil_strength_has_configured_mean_and_variation_over_100_seeds():
    kpa = np.array(
        [surface_of(cone_index_kpa=900.0, cone_index_spread=0.3, seed=seed).cone_index / 1e3 for seed in SEEDS]
    )
    assert kpa.mean() == pytest.approx(900.0, rel=0.015)
    assert kpa.std() / kpa.mean() == pytest.approx(0.3, rel=0.04)
    logs = np.log(kpa) - np.log(kpa).mean()
    assert lag(logs, 4) / logs.var() == pytest.approx(np.exp(-1.0), abs=0.03)


def test_moisture_reduces_soil_strength_and_friction_together():
    wet = surface_of(cone_index_kpa=900.0, moisture_sd_percent=2.0)
    logs = np.log(wet.friction), np.log(wet.cone_index / 900e3)
    assert np.corrcoef(*(log.ravel() for log in logs))[0, 1] == pytest.approx(1.0)
    assert logs[1] == pytest.approx(4.0 * logs[0])
    assert logs[0].std() == pytest.approx(0.02 * 2.0, rel=0.25)


def test_soil_variations_depend_only_on_the_seed_and_differ_per_property():
    a, b, other = (surface_of(cone_index_kpa=900.0, cone_index_spread=0.3, seed=s) for s in (1, 1, 2))
    assert np.array_equal(a.cone_index, b.cone_index)
    assert not np.allclose(a.cone_index, other.cone_index)
    both = surface_of(cone_index_kpa=900.0, cone_index_spread=0.3, friction_spread=0.1)
    assert np.array_equal(both.cone_index, a.cone_index)
    assert abs(np.corrcoef(both.friction.ravel(), both.cone_index.ravel())[0, 1]) < 0.3


def test_patches_replace_the_soil_variation_on_any_terrain():
    patch = CirclePatch(radius_m=5.0, surface="sand", cell_m=0.5)
    varied = Variation(cone_index_spread=0.4, correlation_m=3.0)
    ground = Rough(half_size_m=20.0, node_m=0.5, patch=(patch,), surface="tilled", variation=varied).ground()
    assert surface_at(ground.surface, 0.0, 0.0) == (0.7, 450e3)
    assert rolling_at(ground.surface, 0.0, 0.0) == 0.09
    friction, strength = surface_at(ground.surface, 12.0, 3.0)
    assert friction == 0.9
    assert strength not in (900e3, 450e3)
    assert rolling_at(ground.surface, 12.0, 3.0) == 0.065


def test_named_surface_sets_all_soil_keys_that_are_not_given():
    ground = Flat(surface="sand", patch=(CirclePatch(surface="concrete", friction=0.8),)).ground()
    assert surface_at(ground.surface, 400.0, -400.0) == (0.7, 450e3)
    assert surface_at(ground.surface, 0.0, 0.0) == (0.8, 5000e3)
    patch = {"kind": "circle", "surface": "sand"}
    scenario = load_scenario("straight_line", {"terrain": {"kind": "flat", "patch": [patch]}})
    again = load_scenario("straight_line", {"terrain": scenario.terrain.model_dump(exclude_none=True)})
    assert again.terrain.ground().surface.friction.min() == 0.7


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {"terrain.variation.cone_index_spread": 0.3},
            "terrain.variation.cone_index_kpa: the mean value is missing",
        ),
        ({"terrain.variation.friction_spread": 0.3, "terrain.variation.cell_m": 0.05}, "terrain.variation: .* cells"),
        ({"terrain.surface": "gravel"}, "terrain.surface"),
        ({"plant.kind": "bicycle", "terrain.surface": "sand"}, "terrain.surface: the bicycle"),
        ({"plant.kind": "bicycle", "terrain.variation.friction_spread": 0.1}, "terrain.variation: the bicycle"),
    ],
)
def test_error_for_an_impossible_ground_property_names_the_key(keys, message):
    with pytest.raises(ScenarioError, match=message) as caught:
        load_scenario("straight_line", keys)
    assert "\n" not in str(caught.value)


def drag(tyre, surface):
    """Return the drive torque divided by the rear radius at a constant 1 m/s [N]."""
    scenario = load_scenario("straight_line")
    plant = MujocoPlant(Mujoco(tyre=tyre), scenario.vehicle, Flat(surface=surface).ground(), Clock())
    plant.reset(scenario.path.at(0.0))
    driver = Driver(plant, plant.truth(), 1.0, 5.0)
    driver.go(6.0)
    torques = []
    for _ in range(40):
        driver.go(0.05)
        torques.append(plant.motion.actuation[2])
    return np.mean(torques) / TractorParameters().rear_wheel_radius_m


@pytest.mark.parametrize("surface", ["concrete", "tilled"])
def test_rolling_resistance_equals_the_value_of_the_named_surface(surface):
    weight = 750 * 9.81
    assert drag(MagicFormula(), surface) == pytest.approx(NAMED[surface].rolling_resistance * weight, rel=0.08)


def test_soil_tyre_model_uses_the_cone_index_but_not_ground_resistance():
    by_name, by_number = drag(Soil(), "sand"), drag(Soil(cone_index_kpa=450.0), None)
    assert by_name == pytest.approx(by_number, rel=0.05)
