"""Kingpin angles of the steering linkage, and the linkage of the shipped backlash scenario."""

import numpy as np

from agrobot_mj import load_scenario
from agrobot_mj.extensions.bench.manoeuvres import kingpins
from agrobot_mj.machine import Linkage, Machine, TractorParameters
from agrobot_mj.plants.mujoco.model import tractor_spec


def test_kingpin_angles_do_not_change_masses_and_wheel_positions():
    tractor, kinds = TractorParameters(), (Linkage(), kingpins.LINKAGE)
    upright, laid = (tractor_spec(Machine(tractor, linkage=linkage)).compile() for linkage in kinds)
    assert np.array_equal(upright.body_pos, laid.body_pos)
    assert np.array_equal(upright.body_inertia, laid.body_inertia)
    assert np.array_equal(upright.jnt_type, laid.jnt_type)


def test_shipped_backlash_scenario_uses_the_validated_steering_linkage():
    steering = load_scenario("steering_backlash").steering
    assert steering.cylinder == kingpins.CYLINDER
    assert steering.valve == kingpins.VALVE
    assert steering.linkage == kingpins.LINKAGE.model_copy(update={"backlash_deg": 1.0})
