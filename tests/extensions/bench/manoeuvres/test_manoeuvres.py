"""Quick version of every manoeuvre with each suitable tyre; slow tests run the complete suite."""

import pytest

from agrobot_mj.extensions.bench.manoeuvres.base import Trial, force_tyres
from agrobot_mj.extensions.bench.manoeuvres.suite import MANOEUVRES, validate

SOME_TYRES = {
    "filters": {"magic_formula"},
    "kingpins": {"magic_formula"},
    "machine size": {"magic_formula"},
    "machines": {"magic_formula"},
    "tipping": {"linear", "magic_formula"},
    "implements": {"linear", "magic_formula"},
    "ruts": {"ruts"},
    "parked across": {"magic_formula", "soil", "ruts"},
    "standing": {"contact", "linear", "magic_formula", "ruts", "soil"},
    "vibration": {"ruts"},
    "outside references": {"soil"},
}
"""Tyres of manoeuvres that do not suit every tyre: on soil, the tractor slides before it tips; implements need linear
slopes; only some tyres have a reference load."""


SHORTER = {
    "antenna_lean": {"DRIVE_S": 70.0, "SETTLED_S": 20.0},
    "closed_motions": {"BRIEFLY": 30},
    "energy": {"BRIEFLY_S": 2.5},
    "machines": {"DRIVE_S": 80.0, "SETTLED_S": 20.0},
    "parking": {"BRIEFLY_S": 20.0},
    "side_slope": {"GRADES_DEG": (5.0, 15.0)},
    "soak": {"BRIEFLY_S": 10.0},
    "standing": {"BRIEFLY_S": 10.0, "DRIFT_MM": 0.3},
}
"""Constants that shorten the manoeuvres further than in the quick suite, by module."""


@pytest.fixture
def _shorter(monkeypatch):
    for module, constants in SHORTER.items():
        for name, value in constants.items():
            monkeypatch.setattr(f"agrobot_mj.extensions.bench.manoeuvres.{module}.{name}", value)


@pytest.mark.usefixtures("_shorter")
@pytest.mark.parametrize("name", MANOEUVRES)
def test_quick_manoeuvre_results_are_within_their_acceptance_limits(name):
    found = Trial(name, quick=True).drive(MANOEUVRES[name])
    assert [check for check in found.checks if not check.passed] == []
    assert found.warnings == 0
    judged = {check.subject for check in found.checks if check.band != "reported"}
    assert judged >= SOME_TYRES.get(name, {tyre.kind for tyre in force_tyres()})
    assert {check.manoeuvre for check in found.checks} == {name}


@pytest.mark.slow
def test_complete_suite_results_are_within_their_acceptance_limits(tmp_path):
    checks = validate(tmp_path)
    assert [check for check in checks if not check.passed] == []
    assert len(checks) > 150
