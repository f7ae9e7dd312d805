"""Files written by the validation suite and its report of failures."""

import json
from math import inf, nan

import numpy as np
import pytest

from agrobot_mj.extensions.bench.manoeuvres import figures, side_slope, suite
from agrobot_mj.extensions.bench.manoeuvres.base import About, Trial
from agrobot_mj.extensions.bench.manoeuvres.suite import number, opening, page, table
from agrobot_mj.simulation.results import MARK
from agrobot_mj.tyres import Linear

ABOUT = About("parking", "drift", "linear", "mm")


@pytest.mark.parametrize(
    ("check", "passed"),
    [
        (ABOUT.near(1.049, 1.0, 0.05), True),
        (ABOUT.near(1.051, 1.0, 0.05), False),
        (ABOUT.near(-0.94, -1.0, 0.05), False),
        (ABOUT.close(3.1, 3.0, 0.2), True),
        (ABOUT.close(2.7, 3.0, 0.2), False),
        (ABOUT.below(-1.1, 1.0), False),
        (ABOUT.above(1.4, 1.5), False),
        (ABOUT.none(0), True),
        (ABOUT.none(1), False),
        (ABOUT.reported(1e9), True),
        (ABOUT.reported(nan), False),
        (ABOUT.below(nan, 1.0), False),
        (ABOUT.above(inf, 1.0), False),
    ],
)
def test_check_passes_if_its_result_is_within_the_acceptance_limits(check, passed):
    assert check.passed is passed


def test_check_is_printed_on_one_line():
    assert ABOUT.near(1.2, 1.0, 0.05).line == "parking, linear: drift: 1.2 mm, theory 1, band ±5 %"
    assert ABOUT._replace(unit="").none(2).line == "parking, linear: drift: 2, band none"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return the folder of a validation: three manoeuvres with figures on the linear tyre, and one that fails."""
    out = tmp_path_factory.mktemp("validation")
    names = ("side slope", "constant radius", "step steer")
    level_plants = Trial.level_plants

    def broken(m):
        m._warned = 2
        yield ABOUT.below(5.0, 1.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(side_slope, "tyres", lambda: [Linear()])
        patch.setattr(Trial, "level_plants", lambda m: level_plants(m, only_linear=True))
        patch.setattr(suite, "MANOEUVRES", {name: suite.MANOEUVRES[name] for name in names} | {"parking": broken})
        told = []
        checks = suite.validate(
            out, quick=True, on_finished=lambda name, checks, seconds: told.append((name, len(checks)))
        )
    return out, checks, told


def test_validate_command_writes_all_its_files(written):
    out, checks, told = written
    assert sorted(str(path.relative_to(out)) for path in out.rglob("*.*")) == [
        MARK,
        "images/side_slope.png",
        "images/step_steer.png",
        "images/understeer.png",
        "validation.json",
        "validation.md",
    ]
    assert all(path.stat().st_size < 200_000 for path in out.rglob("*.png"))
    assert [name for name, _ in told] == ["side slope", "constant radius", "step steer", "parking"]
    assert sum(count for _, count in told) == len(checks) - 1


def test_failed_checks_are_listed_in_the_validation_files(written):
    out, checks, _ = written
    failed = [(check.manoeuvre, check.measured) for check in checks if not check.passed]
    assert failed == [("parking", 5.0), ("MuJoCo", 2.0)]
    rows = json.loads((out / "validation.json").read_text())
    assert [row["passed"] for row in rows].count(False) == 2
    assert rows[-1]["measured"] == 2
    text = (out / "validation.md").read_text()
    assert "**5**" in text
    assert "warnings in all manoeuvres: 2." in text


def test_validation_page_has_a_section_per_manoeuvre(written):
    out, _, _ = written
    text = (out / "validation.md").read_text()
    assert text.count("\n## ") == 4
    for name in ("side_slope", "understeer", "step_steer"):
        assert f"](images/{name}.png)" in text
    assert "| understeer gradient [mrad s2/m] | 3.757 | 3.757 |" in text


def test_validation_table_has_one_column_per_model():
    checks = [
        About("loads", "front", "contact", "N").reported(10.0, 12.0),
        About("loads", "front", "bicycle", "N").near(11.0, 12.0, 0.01),
        About("loads", "rear", "bicycle", "N").near(0.0001, 0.0001, 0.01),
        About("loads", "rear", "contact", "N").reported(3.0),
    ]
    assert table(checks).splitlines() == [
        "| quantity | theory | bicycle | contact | band |",
        "|---|---:|---:|---:|---:|",
        "| front [N] | 12 | **11** | *10* | ±1 % |",
        "| rear [N] | (each) | < 0.001 (< 0.001) | *3* | ±1 % |",
    ]


def test_validation_page_counts_only_results_with_acceptance_limits():
    checks = [ABOUT.below(0.1, 1.0), ABOUT.reported(7.0), ABOUT.below(3.0, 1.0)]
    assert "1 of 2 numbers" in page(checks, {"parking": "Parking\n\nWords."})


def test_numbers_and_docstring_summaries_are_formatted_for_the_page():
    assert [number(v) for v in (0.0, 80581.4, 3.75675, -0.42, 4e-9)] == ["0", "80581", "3.757", "-0.42", "< 0.001"]
    assert opening("Words\nwrap\n\n    a = b\n\nend.\n\nMore.") == "Words\nwrap\n\n```\na = b\n```\n\nend."


def test_antenna_offset_figure_has_a_fit_through_the_measurements():
    """The measured offset is 20.8 cm at 10 deg with linear tyres."""
    line, mark = figures.antenna_lean({"pd, paper's sensors": {"linear": [(10.0, 0.208)]}}).axes[0].lines[:2]
    assert np.interp(10.0, *line.get_data()) == pytest.approx(mark.get_ydata()[0], abs=0.5)
