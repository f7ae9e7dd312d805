"""Report page of a validation."""

import json

import pytest
from pages import check_damage, check_page

from agrobot_mj.simulation.results import claim
from agrobot_mj.studies.pages.report import write_report

pytest.importorskip("plotly", reason="plotly is not installed: pip install 'agrobot-mj[report]'")
CHECKS = [
    {"manoeuvre": "parking", "quantity": "creep", "subject": subject, "measured": 0.1, "theory": None, "unit": "mm",
     "low": 0.0, "high": high, "band": "below 1", "passed": True}
    for subject, high in (("bicycle", 1.0), ("linear", None))
]  # fmt: skip


def test_report_shows_validation_results_with_acceptance_limits(tmp_path):
    claim(tmp_path, ["validation.json"])
    (tmp_path / "validation.json").write_text(json.dumps(CHECKS))
    write_report(tmp_path)
    check_page(tmp_path)


@pytest.mark.parametrize("content", ["", "null", "3", "[" * 3000, '{"laws": 3}', "[3]"])
def test_damaged_validation_file_is_reported(tmp_path, content):
    check_damage(tmp_path, "validation.json", content)
