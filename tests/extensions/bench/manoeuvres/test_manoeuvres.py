"""Every manoeuvre in its quick version passes on every tyre; the whole suite does when it has the time."""

import pytest

from agrobot_mj.extensions.bench.manoeuvres import validate
from agrobot_mj.extensions.bench.manoeuvres.base import Trial, force_tyres
from agrobot_mj.extensions.bench.manoeuvres.suite import MANOEUVRES

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
"""Where not every tyre can be judged: soil slides off before it tips; implements need linear slopes; the law of
one tyre has a reference load."""


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
