"""Digital twin from the log of an unknown machine: intervals contain the hidden parameters."""

import json
import re
import sys
import tomllib
from contextlib import redirect_stdout
from io import StringIO
from math import cos, radians, sin, sqrt

import numpy as np
import pyarrow as pa
import pytest
from notebooks import executed, lengths
from stranger import MAP, answers, hidden, write_log

from agrobot_mj import load_scenario
from agrobot_mj.cli import main
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.calibrate import calibrate
from agrobot_mj.extensions.logs.maps import LogMap, read_map
from agrobot_mj.extensions.logs.quantities import Quantity
from agrobot_mj.extensions.logs.recording import read_recording
from agrobot_mj.extensions.logs.twin.machine import TwinKey, _tyres, not_told
from agrobot_mj.extensions.logs.twin.twin import _texts, way

BICYCLE = ("--set", "plant.kind=bicycle")


quickly = pytest.mark.usefixtures("quick_fit")


def twin_of(seed, folder):
    """Run the command `twin` on the log of a machine. Return hidden parameters, result and output."""
    h = write_log(seed, folder / "log.csv")
    (folder / "map.toml").write_text(MAP)
    given = (folder / "log.csv", "--map", folder / "map.toml", *BICYCLE, "--out", folder / "twin")
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as out:
        patch.setattr(sys, "argv", ["agrobot-mj", "twin", *map(str, given)])
        with pytest.raises(SystemExit) as leaving:
            main()
    assert not leaving.value.code
    return h, json.loads((folder / "twin" / "twin.json").read_text()), out.getvalue()


def inside(h, found):
    """Return whether the true value is inside the interval, by quantity."""
    ends = {key: (found[key]["low"], found[key]["high"]) for key in answers(h)}
    return {
        key: (low is None or low <= true) and (high is None or true <= high)
        for key, true in answers(h).items()
        for low, high in [ends[key]]
    }


TURNED, AHEAD, LEFT, TO_CG = radians(30), 0.4, 0.3, 0.7


def straight(sigma):
    """Return a recording of 1000 s at 5 m/s with fixes at 10 Hz of a point off R, along a line at 30 deg."""
    t = np.arange(0, 1000, 0.1)
    random, c, s = np.random.default_rng(5), cos(TURNED), sin(TURNED)
    ahead, left = 5.0 * t + AHEAD, LEFT + sigma * random.standard_normal(len(t))
    columns = {"x": c * ahead - s * left, "y": s * ahead + c * left, "heading": np.full(len(t), 30.0)}
    tables = {
        "time": {"column": "t"},
        "steer": {"column": "steer"},
        "speed": {"column": "speed"},
        "heading": {"column": "heading", "convention": "enu"},
        "position": {"east": "x", "north": "y", "ahead_m": AHEAD, "left_m": LEFT},
    }
    table = pa.table({"t": t, "steer": 0 * t, "speed": np.full(len(t), 5.0), **columns})
    return read_recording(table, LogMap.model_validate(tables), 2.0)


def test_twin_track_is_the_cg_track_sampled_every_half_metre():
    found = way([straight(0.0)], TO_CG)
    along = np.hypot(*np.diff(found[:, :2], axis=0).T)
    assert found[0] == pytest.approx([TO_CG * cos(TURNED), TO_CG * sin(TURNED), 5.0], abs=1e-3)
    assert along == pytest.approx(0.5, abs=1e-3)
    assert found[-1, :2] == pytest.approx((TO_CG + 0.5 * len(along)) * np.array([cos(TURNED), sin(TURNED)]), abs=0.01)


def test_twin_track_is_smoothed_by_cubics_over_two_seconds():
    """A cubic through 2 m + 1 samples of white noise leaves 3 (3 m^2 + 3 m - 1) / ((2 m - 1) (2 m + 1) (2 m + 3)) of
    its variance."""
    x, y, _ = way([straight(0.02)], TO_CG).T
    across = (y * cos(TURNED) - x * sin(TURNED))[20:-20]
    m = 10
    share = 3 * (3 * m**2 + 3 * m - 1) / ((2 * m - 1) * (2 * m + 1) * (2 * m + 3))
    assert across.std() == pytest.approx(0.02 * sqrt(share), rel=0.1)


@pytest.mark.parametrize(("radius", "files"), [(0.5, 1), (15.0, 3)])
def test_track_too_tight_for_the_machine_gives_no_scenario(radius, files):
    """The minimum turning radius of the tractor is 2 m."""
    angle = np.arange(0.0, 4.5, 0.5 / radius if radius > 1 else 0.2)
    points = np.column_stack([radius * np.sin(angle), radius * (1 - np.cos(angle)), np.full(len(angle), 1.5)])
    assert len(_texts("log", load_scenario("straight_line"), {}, points)) == files


@pytest.mark.parametrize(("rear", "identified", "keys"), [(6.0, True, 3), (6.0, False, 0), (89.0, True, 0)])
def test_tyre_parameters_are_written_for_both_axles_or_for_none(rear, identified, keys):
    scenario = load_scenario("straight_line")
    t, found = scenario.tractor, {}
    for axle, C in (("front", 5.0 * t.front_axle_load), ("rear", rear * t.rear_axle_load)):
        found[f"{axle}_cornering_stiffness_n_rad"] = Quantity(C, 0.9 * C, 1.1 * C, axle == "front" or identified)
        found[f"{axle}_relaxation_length_m"] = Quantity(0.01, 0.005, 0.015, True)
    tyres = _tyres(found, scenario)
    assert len(tyres) == keys
    scenario.changed({key: each.value for key, each in tyres.items()})


def test_twin_report_gives_the_source_of_unidentified_quantities():
    scenario = load_scenario("straight_line", {"machine": "utility", "tractor.mass_kg": 2600.0})
    key = "tractor.steer_limit_deg"
    found = {name: (value, source) for name, value, source in not_told(scenario, {key: TwinKey(50.0, "of the log")})}
    assert key not in found
    assert found["tractor.mass_kg"] == (2600.0, "given")
    assert found["tractor.wheelbase_m"] == (scenario.tractor.wheelbase_m, "machine utility")
    assert found["tractor.pitch_inertia_kg_m2"][1] == "default"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("one")
    return folder, *twin_of(0, folder)


@pytest.fixture
def one(made):
    """Return the folder of the first of the twins `made`."""
    return made[0]


def test_true_parameters_are_inside_their_intervals(made):
    """At most one of 13 intervals of 95 % may miss the true value."""
    _, h, found, out = made
    misses = [key for key, right in inside(h, found["found"]).items() if not right]
    assert len(found["found"]) >= 13
    assert len(misses) <= 1, misses
    assert found["held_out"]["yaw_rate"]["explained"] > 0.97
    assert found["held_out"]["position"]["windows_rms"] < 0.04
    assert "m were driven in reverse" in out
    assert "assumed wheelbase of 1.4 m (default)" in out
    assert "No scenario.toml" not in out


@pytest.mark.slow
def test_intervals_contain_the_true_value_in_18_of_20_machines(tmp_path_factory):
    counts = dict.fromkeys(answers(hidden(0)), 0)
    for seed in range(20):
        h, found, _ = twin_of(seed, tmp_path_factory.mktemp("one"))
        for key, right in inside(h, found["found"]).items():
            counts[key] += right
    print(counts)
    assert min(counts.values()) >= 18, counts


def test_twin_files_document_identified_values_and_run(one, call):
    folder = one / "twin"
    machine = (folder / "machine.toml").read_text()
    assert " to " in machine.partition("front_cornering_stiffness_n_rad = ")[2].splitlines()[0]
    tables = tomllib.loads(machine)
    assert tables["steering"]["linkage"]["backlash_deg"] == pytest.approx(hidden(0).play, abs=0.3)
    scenario = load_scenario(folder / "scenario.toml")
    assert scenario.tractor.wheelbase_m == 1.4
    assert scenario.path.duration_s > 60
    status, _, err = call("run", str(folder / "scenario.toml"), "--set", "duration_s=5", "--no-rrd", "--out", "again")
    assert status == 0, err
    page = (folder / "report.html").read_text()
    for text in (
        "Identified parameters",
        "Parameters that the log does not identify",
        "Evaluation on held-out data",
        "Residual of the position",
        "log.csv: the positions scatter by ",
    ):
        assert page.count(text) == 1
    known = page.partition("Identified parameters")[2].partition("Parameters that the log does not identify")[0]
    sensors, vehicle = known.split("Vehicle:")
    cell = r"<td>{}</td>(<td[^>]*>[^<]*</td>){{3}}<td>{}</td><td>(yes|no)</td>"
    for part, key, unit in ((sensors, "steer.scale", "deg per reading"), (vehicle, "backlash_deg", "deg")):
        assert re.search(cell.format(key.replace("_", "_<wbr>"), unit), part)
    assert "steer_<wbr>scale" not in known  # the fit's, over a rough line
    log_map = read_map(folder / "map.toml")
    assert log_map.steer.offset == pytest.approx(hidden(0).centre, abs=0.5)
    assert log_map.steer.positive == ("left" if hidden(0).scale > 0 else "right")


def test_calibration_with_a_calibrated_map_finds_no_further_offset(one):
    """The map contains the calibrated values, so the command reports no further correction of the centre."""
    found = calibrate([one / "log.csv"], read_map(one / "twin" / "map.toml"), load_scenario("straight_line"), 5, 60)
    assert not found.found["steer.offset"].excludes(found.steer.offset)
    assert abs(found.found["heading.delay_s"].value - read_map(one / "twin" / "map.toml").heading.delay_s) < 0.03


@quickly
def test_effect_of_a_wrong_steering_centre_is_given_in_centimetres(one, tmp_path, call):
    """15 counts give tan(15 scale) 2^2 / (2 L) for pure pursuit, minus 2 m times the heading error."""
    h = hidden(0)
    text = (one / "twin" / "map.toml").read_text()
    given = tomllib.loads(text)["steer"]
    wrong = text.replace(f"offset = {given['offset']}", f"offset = {given['offset'] + 15}", 1)
    (tmp_path / "wrong.toml").write_text(wrong)
    status, out, err = call(
        "twin", "--only", "calibrate", str(one / "log.csv"), "--map", str(tmp_path / "wrong.toml"), "--to", "60"
    )
    assert status == 0, err
    assert f"but the map has {given['offset'] + 15:g}." in out
    side = "left" if h.scale > 0 else "right"
    assert f"The wheels point {15 * abs(h.scale):.1f} deg further to the {side} than in the map" in out


@quickly
def test_twin_command_calibrates_replays_and_prints_json(one, tmp_path, call):
    given = (one / "log.csv", "--map", one / "twin" / "map.toml", *BICYCLE, "--to", 60, "--out", "parts")
    status, out, err = call("twin", *given, "--only", "calibrate,replay", "--json")
    assert (status, err) == (0, "")
    document, folder = json.loads(out), tmp_path / "parts"
    assert document["folder"] == "parts"
    for part, file in (("calibrate", "calibration.json"), ("replay", "replay.json")):
        assert document[part] == json.loads((folder / file).read_text())
    assert {"map.toml", "replay.parquet", "replay.png"} <= {path.name for path in folder.iterdir()}
    status, again, err = call("calibrate", *given[:-2])
    assert status == 0
    assert err.startswith("calibrate: use `agrobot-mj twin --only calibrate`")
    assert (folder / "map.toml").read_text().strip() in again


def test_report_command_names_the_existing_report_of_a_twin(call, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "twin.json").touch()
    assert call("report", "mine") == (2, "", "mine: twin has already written its report, report.html, to this folder\n")


def test_unknown_analysis_name_for_the_twin_command_is_reported(call):
    status, _, err = call("twin", "log.csv", "--only", "calibrat")
    assert status == 2
    assert err.startswith("--only calibrat: unknown part; did you mean 'calibrate'")


@quickly
def test_latency_outside_the_search_range_is_rejected(one):
    log_map = read_map(one / "twin" / "map.toml")
    old = log_map.model_copy(update={"position": log_map.position.model_copy(update={"delay_s": -2.0})})
    with pytest.raises(
        FieldLogError, match=r"latency of \[position\] is at the limit .* \+1.5 s from the value in the column map; set"
    ):
        calibrate([one / "log.csv"], old, load_scenario("straight_line"), 5, 60)


@lengths
def test_twin_command_turns_a_log_into_a_scenario_that_runs(tmp_path, full):
    """Hidden values are inside 1.5 times their intervals (3 of 1000 logs are outside), the owner's steering centre is
    outside, and the twin runs."""
    pairs = "(found.found['steer.offset'], CENTRE), (found.found['steer.scale'], SCALE)"
    quarter = "(found.high - found.low) / 4"
    ends = f"[[found.low - {quarter}, hidden, found.high + {quarter}] for found, hidden in ({pairs})]"
    said, (centre, scale) = executed(tmp_path, "log_to_twin", full, ends)
    assert centre == sorted(centre)
    assert centre[-1] < 447
    assert scale == sorted(scale)
    assert "The steering centre is about 43" in said
    assert re.search(r"^completed, \d", said, re.M)
    assert "Twin of field.csv" in (tmp_path / "machine.toml").read_text(encoding="utf-8")
