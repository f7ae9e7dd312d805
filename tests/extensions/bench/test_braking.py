"""Brakes: parked tractors stay at rest, wheels do not lock, and the validation detects a weak brake."""

from math import hypot

import pytest

from agrobot_mj.core.signals import NEUTRAL_V, Drive
from agrobot_mj.extensions.bench.manoeuvres import base, braking, standing
from agrobot_mj.extensions.bench.manoeuvres.base import Trial
from agrobot_mj.machine.driveline import BRAKING_M_S2
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import Slope
from agrobot_mj.tyres import MagicFormula

BRAKED = Drive(NEUTRAL_V, NEUTRAL_V, 1.0)


@pytest.mark.parametrize("tyre", ["contact", "linear", "magic_formula", "soil", "ruts"])
def test_parked_tractor_stays_at_rest_with_every_tyre_model(tyre):
    slope = Slope(grade_deg=9.0, direction_deg=-50.0)
    plant, _ = base.mujoco_plant(base.tyre_of(tyre), slope)
    truths = [plant.advance(BRAKED) for _ in range(600)]
    assert hypot(truths[-1].x - truths[0].x, truths[-1].y - truths[0].y) < 5e-5


def test_machine_with_four_brakes_stops_without_locking_a_wheel():
    scenario = load_scenario("straight_line", {"machine": "robot", "driveline.connected": False})
    trial = Trial("standing")
    assert standing.deceleration(trial, scenario) > BRAKING_M_S2
    rear = scenario.changed({"driveline.brake_front_share": 0.0})
    assert standing.deceleration(trial, rear) < BRAKING_M_S2


def test_validation_detects_a_brake_that_is_too_weak(monkeypatch):
    monkeypatch.setattr(braking, "force_tyres", lambda: [MagicFormula()])
    monkeypatch.setattr(braking, "MASSES_KG", ())
    assert [check.passed for check in braking.run(Trial("brake"))] == [True] * 3
    monkeypatch.setattr(braking, "CAPACITY_N_M", 1050.0)
    assert [check.passed for check in braking.run(Trial("brake"))] == [False] * 3
