"""Published references: all results are within their limits, and wrong tyres violate these limits."""

import pytest

from agrobot_mj.extensions.bench.manoeuvres import references
from agrobot_mj.extensions.bench.manoeuvres.base import Trial
from agrobot_mj.extensions.bench.manoeuvres.suite import MANOEUVRES
from agrobot_mj.machine.tyre_size import TyreSize
from agrobot_mj.scenario.loading import load_scenario


def checks():
    return Trial("outside references").drive(references.run).checks


def test_simulation_results_agree_with_all_published_references():
    found = checks()
    assert [check.line for check in found if not check.passed] == []
    assert sum(check.band != "reported" for check in found) == 11
    assert MANOEUVRES["outside references"] is references.run


@pytest.mark.parametrize("factor", [0.7, 2.5])
def test_check_against_published_results_detects_wrong_tyre_stiffness(factor, monkeypatch):
    stiffness = TyreSize.stiffness
    monkeypatch.setattr(TyreSize, "stiffness", lambda size, bar: factor * stiffness(size, bar))
    failed = [check.quantity for check in checks() if not check.passed]
    assert sum(quantity.startswith("loaded radius") for quantity in failed) >= 4


def test_default_tyres_have_more_traction_on_soil_than_stiff_tyres():
    tractor = load_scenario("straight_line", {"machine": "utility"}).tractor
    ends = {"front": tractor.front_wheel, "rear": tractor.rear_wheel}
    stiff = tractor.model_copy(
        update={f"{end}_tyre_stiffness_n_m": 2.5 * wheel.stiffness for end, wheel in ends.items()}
    )
    by_size, hard = (references.best_pull(each, 450.0) for each in (tractor, stiff))
    assert by_size.efficiency > hard.efficiency + 0.05
    assert by_size.slip < hard.slip
