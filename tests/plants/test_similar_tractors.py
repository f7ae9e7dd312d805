"""Every scenario starts at rest on tractors of the same shape with other masses."""

from math import dist, hypot

import pytest
from similar import similar

from agrobot_mj.core.signals import NEUTRAL_V, Drive
from agrobot_mj.scenario.loading import load_scenario, scenario_files
from agrobot_mj.simulation.loop import Loop

MASSES_KG = (700.0, 2000.0, 5000.0, 9000.0)
PARKED = Drive(NEUTRAL_V, NEUTRAL_V, 1.0)
SOME = (
    ("uphill", 700.0),
    ("figure_eight", 700.0),
    ("side_slope_15", 2000.0),
    ("bumps", 2000.0),
    ("headland_k_turn", 2000.0),
    ("downhill", 5000.0),
    ("steering_backlash", 5000.0),
    ("grain_cart", 5000.0),
    ("plough", 9000.0),
    ("side_slope_10", 9000.0),
    ("furrows_across", 9000.0),
    ("figure_eight_soft_soil", 9000.0),
)
"""Default pairs of scenario and mass: each mass, slopes in all directions, rough ground, soil, implements."""


def fastest(truth):
    """Return the maximum speed of the CG and of a point at a distance of one metre [m/s]."""
    return max(hypot(truth.speed, truth.lateral_speed), abs(truth.yaw_rate))


def check(name, mass_kg, capsys):
    scenario = similar(load_scenario(name), mass_kg)
    loop = Loop(scenario)
    start, path = loop.truth, scenario.path.at(0.0)
    assert capsys.readouterr().err == ""
    assert fastest(start) < 1e-3
    assert dist((start.x, start.y), (path.x, path.y)) < 2e-3
    truths = [loop.plant.advance(PARKED, loop.stages.conditions) for _ in range(60)]
    assert max(map(fastest, truths)) < 1e-3
    assert dist((start.x, start.y), (truths[-1].x, truths[-1].y)) < 1e-3


@pytest.mark.parametrize(("name", "mass_kg"), SOME)
def test_tractor_of_any_size_starts_at_rest_and_stays(name, mass_kg, capsys):
    check(name, mass_kg, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("mass_kg", MASSES_KG)
@pytest.mark.parametrize("name", scenario_files())
def test_every_scenario_starts_at_rest_with_every_tractor_size(name, mass_kg, capsys):
    check(name, mass_kg, capsys)
