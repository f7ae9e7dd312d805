"""Validation of implements at the hitch: yaw gain, off-tracking, draught and hitch force."""

import pytest

from agrobot_mj.extensions.bench.manoeuvres import implements
from agrobot_mj.extensions.bench.manoeuvres.base import Trial
from agrobot_mj.machine.tractor import TractorParameters

TRACTOR = TractorParameters()
L = TRACTOR.wheelbase_m


@pytest.fixture(scope="module")
def checks():
    found = Trial("implements", quick=True).drive(implements.run)
    assert found.warnings == 0
    return found.checks


def test_yaw_gain_offtracking_draught_and_hitch_pull_match_theory(checks):
    assert len(checks) == 14
    assert [check.line for check in checks if not check.passed] == []


def test_implement_changes_the_yaw_gain_of_the_tractor():
    alone = 2.0 / (L + 2.0**2 * TRACTOR.mass_kg * (0.38 / 14800 - 0.62 / 30000))
    assert implements.three_axles(TRACTOR, implements.PLOUGH, 2.0).gain < 0.7 * alone
    assert implements.with_trailer(TRACTOR, implements.TRAILER, 2.0).gain > 1.01 * alone


def test_implement_check_detects_a_wrong_soil_stiffness(monkeypatch):
    softer = implements.PLOUGH.tool.model_copy(update={"cornering_stiffness_n_deg": 180.0})
    driven = implements.PLOUGH.model_copy(update={"tool": softer})
    theory = lambda tractor, plough, u: implements.three_axles(tractor, implements.PLOUGH, u)  # noqa: E731
    found = implements.turns(Trial("implements"), driven, theory, "mounted tool", 8.0)
    assert {check.passed for check in found} == {False}
