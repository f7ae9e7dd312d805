"""Failed runs have no error metrics in any study: laws that stand still, stop early or move, with each command."""

import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
from standing import AWAY, standing

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture
def plugin(tmp_path, request):
    return standing(tmp_path, request.node.name)


def compared(call, plugin, *more):
    file, still = plugin
    laws = ("--plugin", file, "--guidance", f"{still},stanley,lqr", "--plants", "bicycle")
    return call("compare", "lane_change", *laws, *AWAY, "--no-rrd", "--out", "out", *more)


def test_laws_that_move_the_tractor_rank_above_a_stationary_law(call, plugin, tmp_path):
    status, out, err = compared(call, plugin, "--seeds", 2)
    still = plugin[1]
    assert status == 1
    assert err.startswith("lane_change: failed 2 of 6: 2 unfinished (drove 0.0 of ")
    shown = [line for line in out.splitlines() if "lateral MSE [m2] |" in line or f"| {still} " in line]
    heads, *lines = [line.split("|") for line in shown]
    numbers = [head.strip() for head in heads].index("lateral MSE [m2]")
    assert len(lines) == 2
    assert {cell.strip() for line in lines for cell in line[numbers:-1]} == {"-"}
    assert f"bicycle-{still}: failed 2 of 2: 2 unfinished (drove 0.0 of " in out
    rows = json.loads((tmp_path / "out" / "comparison.json").read_text())
    for row in rows:
        failed = row["guidance"] == still
        assert row["expected"] is not failed
        assert (row["xte_rms"] is None) is (row["lateral_mse"] is None) is (row["per_turn"] is None) is failed
        measured = json.loads((tmp_path / "out" / row["folder"] / "metrics.json").read_text())
        assert measured["xte_rms"] is not None
    status, _, _ = call("report", "out")
    page = (tmp_path / "out" / "report.html").read_text().replace("<wbr>", "")
    assert status == 0
    ranked = re.findall(
        r"<tr><td>(bicycle: [^<]*)</td><td class=\"number\">2</td><td class=\"number\">(\d+)</td>", page
    )
    assert ranked[-1] == (f"bicycle: {still}", "0")
    assert {rate for _, rate in ranked[:-1]} == {"100"}
    (charts,) = re.findall(r"const CHARTS = (\{.*?\});\n", page)
    boxes = json.loads(charts.replace("<\\/", "</"))["chart0"]["data"]
    assert len(boxes) == 2
    assert not any(still in box["name"] for box in boxes)


def test_run_stopped_by_the_supervisor_is_not_ranked_best(call, tmp_path):
    """In the first metre of a lane change, the cross-track error of every law is small."""
    variants = ("--variant", "free: title=free", "--variant", "tight: supervisor.max_cross_track_m=0.02")
    laws = ("--guidance", "lqr", *variants, "--plants", "bicycle")
    status, out, _ = call("compare", "lane_change", *AWAY, *laws, "--no-rrd", "--out", "out")
    assert status == 1
    free, tight = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert tight["outcome"] == "stopped"
    measured = json.loads((tmp_path / "out" / tight["folder"] / "metrics.json").read_text())
    assert measured["xte_rms"] < free["xte_rms"]  # what would have been ranked first
    assert re.search(r"bicycle-tight_lqr: failed 1 of 1: 1 stopped \(.* off the path\); errors exclude these runs", out)
    call("report", "out")
    page = (tmp_path / "out" / "report.html").read_text().replace("<wbr>", "")
    assert page.index("<td>bicycle: free") < page.index("<td>bicycle: tight")


def test_tracking_errors_on_different_path_sections_are_not_compared(call, tmp_path):
    variants = ("--variant", "slow: path.speed_m_s=0.6", "--variant", "long: duration_s=12")
    same = ("--variant", "as it is: title=x", "--variant", "noisy: sensors.gnss.sigma_m=0.03")
    common = ("--guidance", "lqr", "--plants", "bicycle", "--no-rrd", "--out", "out")
    status, out, err = call("compare", "lane_change", *AWAY, *common, *same, *variants)
    assert (status, err) == (0, "")
    rows = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert {row["variant"]: row["piece"] for row in rows} == {"as it is": 1, "noisy": 1, "slow": 2, "long": 3}
    assert "the runs cover different segments of the path (column piece)" in out
    call("report", "out")
    page = (tmp_path / "out" / "report.html").read_text().replace("<wbr>", "")
    assert page.count("<h2>Ranking on segment") == 3


def test_sweep_table_has_no_tracking_errors_of_stationary_runs(call, plugin, tmp_path):
    file, still = plugin
    (tmp_path / "mine.toml").write_text(
        f'base = "lane_change"\n[set]\nduration_s = 9\n"plant.kind" = "bicycle"\n[axes]\n'
        f'"guidance.kind" = ["{still}", "lqr"]\n"steering.valve.dead_band_v" = [0.2, 0.4]\n'
        '"sensors.gnss.sigma_m" = [0.01, 0.02]\n'
    )
    status, _, _ = call("sweep", "mine.toml", "--plugin", file, "--jobs", 1, "--out", "out", "-q")
    assert status == 0
    rows = pq.read_table(tmp_path / "out" / "sweep.parquet").to_pylist()
    assert {row["outcome"] for row in rows if row["guidance.kind"] == still} == {"unfinished"}
    status, _, err = call("report", "out", "--plugin", file)
    assert (status, err) == (0, "")
    page = (tmp_path / "out" / "report.html").read_text().replace("<wbr>", "")
    assert page.index("<td>lqr") < page.index(f"<td>{still}")
    assert "<td>4 of 4: 4 unfinished (drove 0.0 of " in page
    (charts,) = re.findall(r"const CHARTS = (\{.*?\});\n", page)
    maps = [
        c["data"][0] for c in json.loads(charts.replace("<\\/", "</")).values() if c["data"][0]["type"] == "heatmap"
    ]
    lowest = min(value for chart in maps for row in chart["z"] for value in row if value is not None)
    assert lowest == pytest.approx(100 * min(row["xte_rms"] for row in rows if row["expected"]), rel=1e-4)
    assert any(
        np.array(chart["z"], dtype=float).size == np.isnan(np.array(chart["z"], dtype=float)).sum() for chart in maps
    )
