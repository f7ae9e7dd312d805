"""Commands for field work: commands of the page, their files and their messages."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from notebooks import executed, lengths
from PIL import Image
from rerun.chunk import RrdReader
from shapely import Polygon
from shapely.geometry import shape

from agrobot_mj.cli import main
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geodesy import Origin, to_geodetic, to_local
from agrobot_mj.extensions.fields.coverage import coverage
from agrobot_mj.extensions.fields.effort import Prices, cost
from agrobot_mj.extensions.fields.evaluation import sentence
from agrobot_mj.extensions.fields.raster import pass_map, write_raster
from agrobot_mj.extensions.fields.resume import Interrupted
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.run import run
from agrobot_mj.terrain.geotiff import cell_and_corner, open_tiff

PAGE = Path(__file__).parents[3] / "docs" / "extensions" / "fields" / "driving.md"
COMMANDS = [shlex.split(line)[1:] for line in re.findall(r"^agrobot-mj .*$", PAGE.read_text("utf-8"), re.M)]
PLANE = Origin(52.0, 5.0)
CORNERS = ((0, 0), (40, 0), (40, 25), (0, 25), (0, 0))


def boundary(folder, corners=CORNERS):
    """Write a field of 0.1 ha as a GeoJSON file."""
    ring = [list(to_geodetic(PLANE, *corner)[::-1]) for corner in corners]
    content = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    file = folder / "field.geojson"
    file.write_text(json.dumps(content))
    return file


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Return the folder in which the commands of the page were executed."""
    folder = tmp_path_factory.mktemp("field_run")
    boundary(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for words in COMMANDS:
            rows = ["--row-spacing", "0.75"] if words[:2] == ["field", "run"] else []
            patch.setattr("sys.argv", ["agrobot-mj", *words, *rows])
            with pytest.raises(SystemExit) as ended:
                main()
            assert ended.value.code == 0, words
    return folder


def test_fields_page_documents_the_three_field_commands():
    assert [" ".join(words[:2]) for words in COMMANDS] == ["field plan", "field run", "report runs/field"]


def test_error_for_a_field_run_on_a_plan_folder_states_the_required_option(tmp_path, call):
    """A plan uses the coordinates of its boundary file, which is not in the folder of the plan."""
    assert call("field", "plan", boundary(tmp_path), "--overlap", "0.4", "--out", "planned")[0] == 0
    status, _, err = call("field", "run", "planned")
    assert status == 2
    assert "specify the boundary file, and --plan planned/field_plan.json" in err


EARLY = """
from math import atan2
from typing import Literal

from agrobot_mj.control.base import GuidanceLaw
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Command
from agrobot_mj.scenario.plugins import register


@register
class Early(GuidanceLaw):
    kind: Literal["early"] = "early"

    def init(self):
        return 0.0

    def update(self, state, situation, dt):
        e, route = situation.estimate, situation.route
        place = route.nearest(e.x, e.y, state, situation.t)
        ahead = route.ahead(place.s + 2.0)
        bearing = wrap(atan2(ahead.y - e.y, ahead.x - e.x) - e.yaw)
        return place.s, Command(min(max(1.2 * bearing, -0.7), 0.7), max(place.speed, 0.3))
"""


def test_motion_beyond_the_end_of_the_plan_is_not_evaluated(tmp_path, call):
    """The law has no speed feedback and passes the end of the plan before the reference."""
    (tmp_path / "early.py").write_text(EARLY)
    words = ("--plugin", tmp_path / "early.py", "--guidance", "early", "--no-reverse", "--no-rrd", "--json")
    status, out, err = call("field", "run", boundary(tmp_path), *words, "--out", tmp_path / "run")
    assert status == 0, err
    found, signals = json.loads(out)["coverage"], pq.read_table(tmp_path / "run" / "signals.parquet")
    assert signals["t"][-1].as_py() > found["time_s"] + 3.0
    assert max(np.abs(signals["x"].to_numpy()).max() - 20.0, np.abs(signals["y"].to_numpy()).max() - 12.5) > 3.0
    assert found["excursions"]["tractor"]["largest_m"] < 1.0


def test_simulated_field_run_covers_the_field(driven):
    found = json.loads((driven / "runs" / "field" / "coverage.json").read_text())
    whole = found["areas"]["field"]
    assert found["outcome"] == "completed"
    assert whole["area_m2"] == pytest.approx(1000.0, rel=1e-4)
    assert whole["covered_m2"] - whole["overlapped_m2"] + whole["missed_m2"] == pytest.approx(
        whole["area_m2"], abs=1e-6
    )
    assert whole["worked_m2"] + whole["missed_m2"] == pytest.approx(whole["area_m2"], abs=1e-6)
    parts = [found["areas"][name]["area_m2"] for name in ("headland", "body")]
    assert sum(parts) == pytest.approx(whole["area_m2"], abs=1e-6)
    assert 0.5 < whole["missed_percent"] < 5.0
    assert re.match(r"0\.09\d+ of 0\.1 ha worked at least once, ", found["summary"])
    assert found["excursions"]["tractor"]["largest_m"] < 0.5
    assert found["turns"]["count"] == 4
    assert 0.2 < found["capacity"]["field_efficiency"] < 0.9


def test_field_run_reports_energy_slip_and_planned_coverage(driven):
    found = json.loads((driven / "runs" / "field" / "coverage.json").read_text())
    effort, plan = found["effort"], found["planned"]["field"]
    assert 0.0 < effort["energy_ground_mj"] < effort["energy_wheels_mj"]
    assert 0.0 < effort["slip_median_percent"] < 10.0
    assert effort["rut_depth_max_m"] is None
    assert 0.0 < plan["missed_percent"] < found["areas"]["field"]["missed_percent"]
    assert "cost" not in found


def test_crop_rows_that_the_wheels_run_over_are_reported(driven):
    found = json.loads((driven / "runs" / "field" / "coverage.json").read_text())
    rows = found["crop_rows"]
    assert rows["rows_m"] == pytest.approx(found["areas"]["body"]["area_m2"] / 0.75, rel=0.05)
    assert 0.0 < rows["run_over_m"] < 0.5 * rows["rows_m"]
    digits = ".3g" if rows["run_over_m"] < 100 else ".0f"
    assert found["summary"].endswith(
        f"{rows['run_over_m']:{digits}} m of crop rows run over ({rows['run_over_percent']:.2g} %)"
    )
    assert "; 2835 m of crop rows" in sentence({**found, "crop_rows": {"run_over_m": 2834.95, "run_over_percent": 7.7}})
    assert "crop rows run over outside the tramlines" in (driven / "runs" / "field" / "report.html").read_text()


def test_metrics_of_a_field_run_agree_with_its_coverage_file(driven):
    found = json.loads((driven / "runs" / "field" / "coverage.json").read_text())
    metrics = json.loads((driven / "runs" / "field" / "metrics.json").read_text())
    whole, out = found["areas"]["field"], found["excursions"]
    assert metrics["field_missed_percent"] == pytest.approx(whole["missed_percent"], abs=1e-3)
    assert metrics["field_overlapped_percent"] == pytest.approx(whole["overlapped_percent"], abs=1e-3)
    assert metrics["implement_beyond_m"] == pytest.approx(out["implement"]["largest_m"], abs=1e-3)
    assert metrics["field_turns_s"] == pytest.approx(found["turns"]["total_s"], abs=0.1)


def test_scenario_file_written_with_a_plan_contains_plan_and_law(driven):
    scenario = load_scenario(str(next(driven.glob("runs/plan-*/scenario.toml"))))
    assert scenario.path.plan.width == 3.0
    assert scenario.guidance.kind == "lqr"


def test_covered_area_in_the_raster_equals_the_reported_area(driven):
    found = json.loads((driven / "runs" / "field" / "coverage.json").read_text())["areas"]["field"]
    image = Image.open(driven / "runs" / "field" / "coverage.tif")
    cells, (east, north, _) = np.asarray(image), image.tag_v2[33550]
    low, high = to_local(PLANE, 52.0, 5.0), to_local(PLANE, 52.0 + north, 5.0 + east)
    area = (high[0] - low[0]) * (high[1] - low[1])
    assert area == pytest.approx(0.25**2, rel=1e-3)
    assert (cells != 255).sum() * area == pytest.approx(found["area_m2"], rel=0.03)
    assert ((cells > 0) & (cells != 255)).sum() * area == pytest.approx(found["worked_m2"], rel=0.03)
    assert image.tag_v2[33922][3:5] == pytest.approx((5.0, to_geodetic(PLANE, 0.0, 25.0)[0]), abs=1e-8)


def test_raster_of_a_field_without_geographic_position_is_in_metres(tmp_path):
    square = Polygon([(10, 20), (18, 20), (18, 26), (10, 26)])
    found = coverage(square, square, [Polygon([(10, 20), (18, 20), (18, 23), (10, 23)])] * 2)
    write_raster(tmp_path / "map.tif", pass_map(found), None)
    image = open_tiff(tmp_path / "map.tif")
    assert cell_and_corner(tmp_path / "map.tif", image) == (0.25, (10.125, 20.125))
    cells = np.asarray(image)
    assert cells.shape == (24, 32)
    assert set(cells[:12].ravel()) == {0}
    assert set(cells[12:].ravel()) == {2}


def test_cost_of_a_field_run_is_proportional_to_areas_and_time():
    found = cost(Prices(200.0, 1000.0, 60.0), {"overlapped_m2": 500.0, "missed_m2": 100.0}, 1800.0)
    assert found == pytest.approx({"overlap": 10.0, "missed": 10.0, "time": 30.0, "total": 50.0})
    assert cost(Prices(hour=60.0), {"overlapped_m2": 500.0, "missed_m2": 100.0}, 1800.0) == {
        "time": 30.0,
        "total": 30.0,
    }


def test_driven_distance_of_a_field_run_agrees_with_its_plan(driven):
    planned = json.loads(next(driven.glob("runs/plan-*/field_plan.json")).read_text())
    log = pq.read_table(driven / "runs" / "field" / "signals.parquet")
    found = json.loads((driven / "runs" / "field" / "coverage.json").read_text())
    assert found["distance_m"] == pytest.approx(sum(piece[0] for piece in planned["pieces"]), rel=0.05)
    assert log.num_rows * 0.05 == pytest.approx(found["time_s"], abs=0.2)
    assert 0.005 < found["accuracy"]["pass_to_pass_p95_m"] < 0.3


def test_field_run_writes_all_its_files(driven):
    names = {path.name for path in (driven / "runs" / "field").iterdir()}
    assert names >= {
        "coverage.json",
        "coverage.geojson",
        "coverage.png",
        "field_plan.json",
        "scenario.toml",
        "report.html",
    }
    shapes = json.loads((driven / "runs" / "field" / "coverage.geojson").read_text())["features"]
    kinds = {each["properties"]["kind"] for each in shapes}
    found = json.loads((driven / "runs" / "field" / "coverage.json").read_text())["areas"]["field"]
    assert kinds >= {"field", "body", "pass", "turn", "pass_area", "worked", "overlapped", "missed"}
    (worked,) = (shape(each["geometry"]) for each in shapes if each["properties"]["kind"] == "worked")
    (outline,) = (shape(each["geometry"]) for each in shapes if each["properties"]["kind"] == "field")
    assert worked.area / outline.area == pytest.approx(found["worked_percent"] / 100, rel=1e-3)
    corner = np.array(shapes[0]["geometry"]["coordinates"][0]).min(axis=0)
    assert corner == pytest.approx([5.0, 52.0], abs=1e-6)


def test_report_of_a_field_run_begins_with_the_coverage(driven):
    text = (driven / "runs" / "field" / "report.html").read_text()
    assert text.index("<h2>Coverage</h2>") < text.index("ha worked at least once") < text.index("<h2>Track</h2>")
    assert "pass-to-pass error at the implement" in text
    layers = [text.index(f'"name": "{name}"') for name in ("worked", "overlapped", "missed", "track", "boundary")]
    assert layers == sorted(layers)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--radius", "1"], "--radius 1: the machine compact has a minimum radius of 1.58 m"),
        (["--width", "30"], "--width 30: the field is too narrow"),
        (["--machine", "nobody"], "machine"),
        (["--overlap", "2"], "--overlap 2: must be at most half of the width"),
        (["--set", "tractor.mass=1"], "tractor.mass"),
        (["--set", "path.kind=line"], 'path.kind: "line" has no effect, because the field determines the path'),
        (["--angle", "1e300"], "'--angle'"),
    ],
)
def test_error_for_an_invalid_option_names_the_option(call, tmp_path, options, message):
    status, out, err = call("field", "plan", str(boundary(tmp_path)), "--out", str(tmp_path / "out"), *options)
    assert (status, out) == (2, "")
    assert message in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("price", "message"),
    [("fuel=1", "the name must be one of input_ha, yield_ha, hour"), ("hour", "the number is missing")],
)
def test_error_for_an_invalid_price_names_the_option(call, tmp_path, price, message):
    status, _, err = call("field", "run", str(boundary(tmp_path)), "--price", price, "--out", str(tmp_path / "out"))
    assert (status, (tmp_path / "out").exists()) == (2, False)
    assert f"--price {price}: {message}" in err


def test_error_for_an_invalid_plan_file_names_the_file(call, tmp_path):
    (tmp_path / "plan.json").write_text('{"format": "agrobot_mj plan 1", "pieces": []}')
    status, _, err = call("field", "run", str(boundary(tmp_path)), "--plan", str(tmp_path / "plan.json"))
    assert status == 2
    assert err.startswith(
        "--plan plan.json: the plan is empty, because it has no path segments; create the plan again with "
        "`agrobot-mj field plan`"
    )


def test_number_of_sections_is_taken_from_the_plan(call, tmp_path):
    field, planned, out = str(boundary(tmp_path)), tmp_path / "planned", tmp_path / "out"
    call("field", "plan", field, "--sections", "3", "--out", str(planned))
    short = ("--set", "duration_s=30", "--set", "plant.kind=bicycle", "--no-rrd", "--out", str(out))
    call("field", "run", field, "--plan", str(planned / "field_plan.json"), *short)
    found = json.loads((out / "coverage.json").read_text())
    assert found["sections"] == 3
    assert found["areas"]["field"]["overlapped_percent"] < 1.0


def test_run_that_ends_before_the_implement_moves_writes_no_files(call, tmp_path):
    short = ("--set", "duration_s=0.05", "--set", "plant.kind=bicycle", "--no-rrd", "--out", str(tmp_path / "out"))
    status, _, err = call("field", "run", str(boundary(tmp_path)), *short)
    assert status == 2
    assert "the run ended before the implement moved" in err
    assert not (tmp_path / "out").exists()


def test_recording_shows_field_boundary_and_missed_areas(call, tmp_path):
    short = ("--set", "duration_s=30", "--set", "plant.kind=bicycle", "--out", str(tmp_path / "out"))
    call("field", "run", str(boundary(tmp_path)), "--quiet", *short)
    chunks = RrdReader(str(tmp_path / "out" / "run.rrd")).stream().to_chunks()
    entities = {chunk.entity_path for chunk in chunks}
    assert entities >= {"/world/areas/boundary", "/world/areas/missed", "/world/areas/passes", "/world/path"}


@pytest.mark.usefixtures("single_ticks")
def test_interrupted_field_run_resumes_with_identical_signals(tmp_path, monkeypatch):
    monkeypatch.setattr("agrobot_mj.extensions.fields.resume.user_cache_path", lambda _: tmp_path / "cache")
    keys = {"plant.kind": "bicycle", "duration_s": 6.0}
    scenario = load_scenario("straight_line", keys)
    calls = iter(range(1000))
    first = Interrupted(scenario, lambda: next(calls) > 80)
    broken = run(scenario, ticks=first.ticks)
    again = Interrupted(load_scenario("straight_line", keys), lambda: False)
    again.load()
    resumed = run(again.scenario, ticks=again.ticks)
    whole = run(scenario)
    assert broken.outcome == "aborted"
    assert broken.rows.filled < resumed.rows.filled == whole.rows.filled
    assert resumed.signals.equals(whole.signals)
    assert not again.file.exists()


def test_resume_without_an_interrupted_field_run_is_rejected(call, tmp_path, monkeypatch):
    monkeypatch.setattr("agrobot_mj.extensions.fields.resume.user_cache_path", lambda _: tmp_path / "cache")
    status, _, err = call(
        "field", "run", str(boundary(tmp_path)), "--resume", "--quiet", "--out", str(tmp_path / "out")
    )
    assert (status, (tmp_path / "out").exists()) == (2, False)
    assert err.startswith("--resume: there is no interrupted drive with these options")


@pytest.mark.parametrize("content", [b"", b"\x80\x04N.", b"I1x\n.", b"cos\nnope\n."])
def test_resume_from_a_damaged_state_is_rejected(tmp_path, monkeypatch, content):
    monkeypatch.setattr("agrobot_mj.extensions.fields.resume.user_cache_path", lambda _: tmp_path)
    again = Interrupted(load_scenario("straight_line"), lambda: False)
    again.folder.mkdir()
    again.file.write_bytes(content)
    with pytest.raises(ScenarioError, match="--resume: there is no interrupted drive"):
        again.load()


@lengths
def test_field_notebook_plans_simulates_and_reports_a_field(tmp_path, full):
    _, missed = executed(tmp_path, "boundary_to_report", full, "found['areas']['field']['missed_percent']")
    assert 0.0 < missed < 10.0
    assert "Field work on home" in (tmp_path / "work" / "report.html").read_text(encoding="utf-8")
    assert (tmp_path / "figure.png").is_file()
