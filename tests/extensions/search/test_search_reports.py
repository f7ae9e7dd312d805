"""Report pages of searches: limits, and importance of the random parameters of a sweep."""

import json

import numpy as np
import pytest
from pages import charts_of, check_damage, check_page, page_of

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.simulation.results import claim
from agrobot_mj.studies.pages.report import write_report
from agrobot_mj.studies.sweep.runner import SweepOptions, sweep

pytest.importorskip("plotly", reason="plotly is not installed: pip install 'agrobot-mj[report]'")
LIMIT = {
    "key": "path.radius_m", "until": "xte_rms > 1", "scenario": "circle", "version": "1", "confidence": 0.8,
    "reliability": 0.7,
    "laws": [{"law": "lqr", "statement": "a < b", "interval": [1, 2], "tried": [
        {"value": 17.8125, "runs": 7, "failed": 0, "low": 0.8, "high": 1.0, "outcomes": {"completed": 7}}]}],
}  # fmt: skip


SCREENING = """
base = "circle"
seeds = 1
method = "METHOD"
samples = 9
[set]
duration_s = 2
"plant.kind" = "bicycle"
[draws]
"steering.valve.dead_band_v" = { uniform = [0.1, 1.5] }
"sensors.gnss.sigma_m" = { uniform = [0.001, 0.002] }
"""


def test_report_of_a_limit_search_contains_the_evaluated_values(tmp_path):
    claim(tmp_path, ["limit.json"])
    (tmp_path / "limit.json").write_text(json.dumps(LIMIT))
    write_report(tmp_path)
    check_page(tmp_path)
    assert "<td>17.8125</td>" in page_of(tmp_path)
    assert "a &lt; b.</p>" in page_of(tmp_path)
    (chart,) = charts_of(tmp_path).values()
    assert [(each["type"], each["y0"], each["y1"]) for each in chart["layout"]["shapes"]] == [
        ("line", 70, 70),
        ("rect", 0, 1),
    ]


@pytest.mark.parametrize("content", ["", "[]", "{}", "null", "3", "[" * 3000, '{"laws": 3}', "[3]"])
def test_damaged_result_file_is_reported(tmp_path, content):
    check_damage(tmp_path, "limit.json", content)


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("falsify.json", r"falsify has no report.*falsify\.json and falsify\.png"),
        ("tuning.json", r"tune has no report; its result is in tuning\.json"),
    ],
)
def test_error_for_a_search_without_a_report_names_its_result_files(tmp_path, file, said):
    (tmp_path / file).touch()
    with pytest.raises(ScenarioError, match=said):
        write_report(tmp_path)


def swept(folder, method="screening"):
    """Return the folder of a sweep with two random parameters."""
    (folder / "mine.toml").write_text(SCREENING.replace("METHOD", method))
    sweep(folder / "mine.toml", folder / "out", SweepOptions(jobs=1, quiet=True))
    return folder / "out"


def test_report_of_a_screening_shows_the_importance_of_parameters(tmp_path):
    out = swept(tmp_path)
    files = {file.name for file in write_report(out)}
    assert {"importance.json", "importance.png"} <= files
    check_page(out)
    assert "<h2>Importance</h2><p>Fraction of the variance of xte_rms" in page_of(out)
    found = json.loads((out / "importance.json").read_text())["groups"][0]["shares"]
    (bars,) = [t for c in charts_of(out).values() for t in c["data"] if t["type"] == "bar"]
    assert bars["y"] == [share["key"] for share in found]
    np.testing.assert_allclose(bars["x"], [share["share"] for share in found], rtol=1e-5)
    write_report(out, "lateral_rms")
    assert "Fraction of the variance of lateral_rms" in page_of(out)
    with pytest.raises(ScenarioError, match="--metric lateral_rmss: no such column"):
        write_report(out, "lateral_rmss")


def test_report_of_a_random_sweep_has_no_importance_section(tmp_path):
    out = swept(tmp_path, "random")
    write_report(out)
    assert "Importance" not in page_of(out)
    with pytest.raises(ScenarioError, match="the design is 'random'; importance needs method"):
        write_report(out, "xte_rms")
