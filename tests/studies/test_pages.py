"""Report pages: one offline file for each kind of results, without empty charts, and with commands for each point."""

import json
import os
import re
import shlex
import sys
import tomllib

import numpy as np
import pyarrow.parquet as pq
import pytest
from pages import charts_of, check_damage, check_page, page_of
from processes import omit_figures

from agrobot_mj import cli, load_scenario
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.simulation.diagnosis import attribution
from agrobot_mj.simulation.results import claim
from agrobot_mj.simulation.run import run
from agrobot_mj.simulation.storage import write_log
from agrobot_mj.studies.compare import compare
from agrobot_mj.studies.compare_plan import plan
from agrobot_mj.studies.pages.document import Document
from agrobot_mj.studies.pages.drive import enlarge, enlargement, map_of, thin_rows, thumbnail
from agrobot_mj.studies.pages.ranking import Group, box
from agrobot_mj.studies.pages.report import over_parameters, ranking, write_report
from agrobot_mj.studies.pages.sweep import RerunCommand, curves, heat_map, toml_value
from agrobot_mj.studies.sweep.runner import SweepOptions, sweep

pytest.importorskip("plotly", reason="plotly is not installed: pip install 'agrobot-mj[report]'")
SHORT = {"plant.kind": "bicycle", "duration_s": 3.0}
SWEEP = """
title = "Laws & speeds <b>"
base = "figure_eight"
seeds = 2
[set]
duration_s = 2
"plant.kind" = "bicycle"
[axes]
"path.speed_m_s" = [0.8, 1.2]
"steering.valve.dead_band_v" = [0.2, 0.6]
"fault" = [[], [{ kind = "gnss_loss", start_s = 0, end_s = 1 }]]
[[variant]]
name = "paper"
[[variant]]
name = "stanley"
set = { "guidance.kind" = "stanley", "expected_outcome" = "stuck" }
"""


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Return results folders of every kind, with their reports."""
    top = tmp_path_factory.mktemp("results")
    (top / "mine.toml").write_text(SWEEP, encoding="utf-8")
    sweep(top / "mine.toml", top / "sweep", SweepOptions(jobs=1, quiet=True))
    scenario = load_scenario("figure_eight", SHORT)
    write_log(run(scenario), top / "run")
    comparison = plan(scenario, ["pd", "pd_t2fnn"], plants=["bicycle"], seeds=2)
    comparison.recorded = False
    with pytest.MonkeyPatch.context() as patch:
        omit_figures(patch)
        compare(comparison, top / "comparison", jobs=1)
    found = {name: top / name for name in KINDS}
    for folder in found.values():
        write_report(folder)
    return found


KINDS = ("sweep", "run", "comparison")


@pytest.mark.parametrize("kind", KINDS)
def test_report_is_a_single_file_without_empty_charts(folders, kind):
    check_page(folders[kind])


def test_metrics_in_the_report_of_a_run_have_units(folders):
    page = page_of(folders["run"])
    assert re.search(r"<td>lateral_<wbr>mse</td><td[^>]*>[^<]*</td><td>m2</td>", page)
    assert re.search(r"<td>yaw_<wbr>rate_<wbr>error_<wbr>rms</td><td[^>]*>[^<]*</td><td>rad/s</td>", page)


def test_error_contributions_are_in_every_report(folders):
    metrics = json.loads((folders["run"] / "metrics.json").read_text())
    assert f"<p>{attribution(metrics).replace('&', '&amp;')}.</p>" in page_of(folders["run"])
    for kind in ("comparison", "sweep"):
        assert all(head in page_of(folders[kind]) for head in ("estimator [cm]", "guidance [cm]"))


def test_user_defined_texts_are_escaped_in_the_report(folders):
    assert "<h1>Laws &amp; speeds &lt;b&gt;</h1>" in page_of(folders["sweep"])


def test_names_in_a_report_cannot_inject_script_tags(tmp_path):
    """The text `<!--<script>` in a script would prevent its end tag, so that no chart appears."""
    name = "<!--<script></script>"
    page = Document(name, [name])
    page.grid([(name, {"data": [{"name": name}], "layout": {}})])
    text = page.write(tmp_path / "report.html").read_text(encoding="utf-8")
    assert name not in text
    assert "<" not in re.search(r"const CHARTS = (.*?);\n", text)[1]
    assert charts_of(tmp_path)["chart0"]["data"] == [{"name": name}]


def test_sweep_report_shows_ranking_maps_curves_and_worst_runs(folders):
    text = page_of(folders["sweep"])
    for section in ("Ranking", "Maps", "Effect of one parameter", "The worst runs", "The sweep"):
        assert f"<h2>{section}</h2>" in text
    assert "The runs cover different segments of the path" in text  # two speeds for two seconds
    assert text.count("<svg viewBox") == 6
    assert text.index("<td>paper") < text.index("<td>stanley")  # stanley never ends as it is expected to
    kinds = {trace["type"] for chart in charts_of(folders["sweep"]).values() for trace in chart["data"]}
    assert kinds == {"scatter", "box", "heatmap", "contour"}
    assert {"ranking.png", "curves.png"} <= {file.name for file in folders["sweep"].iterdir()}


@pytest.mark.parametrize("number", [0, 31])
def test_command_shown_for_a_point_of_a_chart_repeats_its_run(folders, number, monkeypatch, tmp_path):
    row = pq.read_table(folders["sweep"] / "sweep.parquet").to_pylist()[number]
    command = RerunCommand(folders["sweep"])(row)
    assert json.dumps(command)[1:-1] in page_of(folders["sweep"]).replace("<\\/", "</")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [*shlex.split(command), "--no-rrd", "-q"])
    with pytest.raises(SystemExit):
        cli.main()
    metrics = json.loads((tmp_path / f"run-{number}" / "metrics.json").read_text())
    assert metrics["xte_rms"] == row["xte_rms"]
    assert metrics["outcome"] == row["outcome"]


def test_values_in_commands_shown_in_a_report_are_valid_toml():
    value = [{"kind": "a b", "x": [1, 2.5], "on": True, "inner": {"k": 'quote"'}}]
    assert tomllib.loads(f"v = {toml_value(value)}")["v"] == value


def test_report_on_a_folder_without_results_is_rejected(tmp_path):
    with pytest.raises(ScenarioError, match="contains no results"):
        write_report(tmp_path)
    with pytest.raises(ScenarioError, match="no such folder"):
        write_report(tmp_path / "nowhere")
    claim(tmp_path, ["comparison.json"])
    (tmp_path / "comparison.json").write_text("[{}]")
    with pytest.raises(
        ScenarioError, match=r"comparison\.json: cannot be reported: this file, or one next to it, is damaged"
    ):
        write_report(tmp_path)


@pytest.mark.parametrize("content", ["", "[]", "{}", "null", "3", "[" * 3000, '{"laws": 3}', "[3]"])
def test_report_on_a_damaged_results_file_names_the_file(tmp_path, content):
    check_damage(tmp_path, "comparison.json", content)


def test_error_for_missing_plotly_names_the_extra(folders, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(ScenarioError, match=r"pip install 'agrobot-mj\[report\]'"):
        write_report(folders["run"])


PROBLEMS = """() => [...document.querySelectorAll('.chart')].flatMap(chart => {
  const box = chart.getBoundingClientRect(), plot = chart.querySelector('.nsewdrag').getBoundingClientRect();
  const legend = chart.querySelector('.legend')?.getBoundingClientRect();
  const under = legend && chart.querySelector('.xtitle').getBoundingClientRect().bottom > legend.top + 1;
  const drawn = chart.querySelectorAll('.trace, .heatmaplayer image, .boxlayer path').length;
  return [drawn ? [] : 'empty', box.right > innerWidth + 1 ? 'wide' : [], plot.height < 120 ? 'flat' : [],
    under ? 'title under the legend' : []].flat();
}).concat(document.documentElement.scrollWidth > innerWidth + 1 ? ['sideways'] : [])"""


@pytest.mark.parametrize("kind", KINDS)
def test_report_renders_in_a_browser_without_errors(folders, kind):
    """The page has the widths of a desktop and of a phone screen. AGROBOT_CHROMIUM may name another browser."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    said = []
    with playwright.sync_playwright() as p:
        try:
            browser = p.chromium.launch(executable_path=os.environ.get("AGROBOT_CHROMIUM"), args=["--no-sandbox"])
        except playwright.Error:
            pytest.skip("no Chromium: playwright install chromium")
        for width in (1440, 390):
            page = browser.new_page(viewport={"width": width, "height": 900})
            page.on("console", lambda message: said.append(message.text))
            page.on("pageerror", lambda error: said.append(str(error)))
            page.goto((folders[kind] / "report.html").as_uri())
            page.wait_for_timeout(1500)
            assert page.evaluate(PROBLEMS) == []
            page.close()
        browser.close()
    assert said == []


def test_commands_shown_in_a_report_wrap_only_between_options(folders):
    (inside, *_) = re.findall(r"<pre>(<span>.*?)</pre>", page_of(folders["sweep"]))
    parts = re.findall(r"<span>(.*?)</span>", inside)
    assert parts[0].startswith("agrobot-mj run ")
    assert all(part.startswith(" --") for part in parts[1:])
    assert parts[-1].startswith(" --out run-")


@pytest.mark.parametrize("yaw", [0.0, 0.7, 3.0])
def test_map_in_the_report_enlarges_only_cross_track_errors(yaw):
    """The tractor is 10 cm left of a line of 100 m and 3 m behind the reference, which stops at the end."""
    s = np.minimum(np.arange(120.0), 100.0)
    forward, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    reference = s[:, None] * forward
    track = reference - 3 * forward + 0.1 * left
    signals = {"x_ref": reference[:, 0], "y_ref": reference[:, 1], "x": track[:, 0], "y": track[:, 1]}
    times = enlargement([signals])
    assert times in (50, 100)
    np.testing.assert_allclose(np.stack(enlarge(signals, times), 1), track + (times - 1) * 0.1 * left, atol=1e-9)
    lost = {**signals, "x": signals["x"] + 20 * left[0], "y": signals["y"] + 20 * left[1]}
    assert enlargement([lost]) == enlargement([signals, lost]) == 1
    assert "<text" not in thumbnail(signals, times), "a text would cover the track of a straight path"
    title, chart = map_of({"one": signals})
    assert f"enlarged {times} times" in title
    assert f"enlarged {times} times" in str(chart["layout"])
    assert "larger" not in str(map_of({"lost": lost})[1])


def test_law_with_only_failures_has_a_success_rate_but_no_box_plot():
    rows = [{"expected": False, "xte_rms": None}, {"expected": False, "xte_rms": 0.1}]
    left, right = ranking([Group("lqr", rows), Group("stanley", rows)]).axes
    assert [label.get_text() for label in left.get_yticklabels()] == ["lqr", "stanley"]
    assert len(left.lines) > len(right.lines) == 0


def test_report_and_printed_figure_have_the_same_quartiles():
    """For eight values, the default quartiles of plotly.js and NumPy differ."""
    rows = [{"expected": True, "outcome": "completed", "xte_rms": k**2 / 100} for k in range(8)]
    drawn, lines = box(Group("lqr", rows), "#000000"), ranking([Group("lqr", rows)]).axes[1].lines
    assert (drawn["q1"], drawn["median"], drawn["q3"]) == ([3.25], [12.5], [27.75])
    assert [list(line.get_xdata()) for line in lines[1:3]] == [
        [*drawn["q1"], *drawn["lowerfence"]],
        [*drawn["q3"], *drawn["upperfence"]],
    ]


def test_box_plot_of_few_runs_shows_every_run_outside_the_box():
    rows = [{"expected": True, "outcome": "completed", "xte_rms": k / 100} for k in range(6)]
    few, many = (box(Group("lqr", rows[:count]), "#000000") for count in (5, 6))
    assert (few["boxpoints"], many["boxpoints"]) == ("all", "outliers")
    assert abs(few["pointpos"]) > 1 > abs(many["pointpos"])


def test_heads_of_number_columns_are_right_aligned():
    page = Document("", [])
    page.table(("law", "runs", "median"), [("lqr", 2, 0.5), ("pd", 0, None)])
    assert re.findall("<th[^>]*>", page.parts[-1]) == ["<th>", *2 * ['<th class="number">']]


def test_empty_columns_are_omitted_from_the_report():
    page = Document("", [])
    page.table(("law", "runs", "failed"), [("lqr", 2, ""), ("pd", 0, "")])
    page.table(("law", "failed"), [("lqr", ""), ("pd", "1 stuck")])
    assert [re.findall("<th[^>]*>([^<]*)", table) for table in page.parts[-2:]] == [["law", "runs"], ["law", "failed"]]


def test_downsampled_curve_keeps_spikes_and_gaps():
    t = np.arange(100_000) * 0.05
    y = np.sin(t / 50)
    y[77_777], y[12_345], y[50_000:60_000] = 9.0, -9.0, np.nan
    x, kept = thin_rows(t, y)
    assert len(x) < 4000
    assert (np.nanmax(kept), np.nanmin(kept)) == (9.0, -9.0)
    assert np.isnan(kept[(x > 2550) & (x < 2950)]).all()
    assert np.all(np.diff(x) > 0)
    assert (x[0], x[-1]) == (t[0], t[-1])
    assert [len(column) for column in thin_rows(t[:100], y[:100])] == [100, 100]


def test_curve_of_a_sampled_parameter_shows_means_over_run_groups():
    """Single runs also differ in other sampled parameters, so a line through them would be irregular."""
    rows = [
        {"v": 3 * k % 11, "w": k % 2, "outcome": "completed", "expected": True, "xte_rms": 0.01 * (k % 2)}
        for k in range(11)
    ]
    axes = over_parameters([Group("all", rows)], ["v", "w"], ["v"]).axes[0]
    points, line = axes.lines
    assert len(points.get_xdata()) == 11
    assert line.get_xdata() == pytest.approx([2.5, 8.0])
    assert len(over_parameters([Group("all", rows)], ["v", "w"]).axes[0].lines[1].get_xdata()) == 11
    chart = curves([Group("all", rows[:4])], "v", lambda row: "", drawn=True)
    assert [len(trace["x"]) for trace in chart["data"]] == [4, 1]


def test_zero_errors_are_plotted_at_zero_and_failures_at_the_top():
    rows = [
        {"run": k, "seed": 1, "v": k, "outcome": outcome, "expected": outcome == "completed", "xte_rms": error}
        for k, (outcome, error) in enumerate([("completed", 0.0), ("completed", 0.02), ("stopped", 0.001)])
    ]
    points = curves([Group("all", rows)], "v", lambda row: "")["data"][0]
    assert points["y"] == pytest.approx([0.0, 2.0, 2.2])
    assert points["marker"]["symbol"] == ["circle", "circle", "x"]
    chart = heat_map(Group("all", [{**row, "w": w} for row in rows for w in (0, 1)]), "v", "w", (0, 1), lambda row: "")
    assert chart["data"][0]["z"] == [[0.0, 2.0, None]] * 2
