"""Identification of valve parameters from noisy runs of both plants; unexcited parameters are not identified."""

import json
from math import degrees

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from turns import by_turns

from agrobot_mj import load_scenario, run
from agrobot_mj.core import table_columns as fieldlog
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.logs.identify.valve import identify
from agrobot_mj.extensions.logs.parts import Job, valve
from agrobot_mj.machine.hydraulics import LITRE_PER_MINUTE
from agrobot_mj.simulation.storage import write_log

TICK_S = 0.05
CALM = {"path.turns": 1, "controller.kind": "pd"}
PLANTS = {
    "bicycle": {"plant.kind": "bicycle"},
    "mujoco": {"plant.kind": "mujoco", "plant.tyre.kind": "magic_formula"},
}
OTHER_VALVE = {
    "delay_s": 0.17,
    "time_constant_s": 0.18,
    "dead_band_v": 0.6,
    "gain_left_l_min_v": 2.0,
    "gain_right_l_min_v": 2.6,
    "pump_flow_l_min": 7.0,
}
VALVES = [pytest.param(None, id="default"), pytest.param(OTHER_VALVE, id="other")]
MORE = [
    pytest.param("mujoco", OTHER_VALVE, id="mujoco-other"),
    pytest.param("bicycle", OTHER_VALVE, id="bicycle-other", marks=pytest.mark.slow),
    pytest.param("mujoco", None, id="mujoco-default", marks=pytest.mark.slow),
]
"""Plants and valves in addition to the default valve on the bicycle, which other tests identify."""
LATE_OIL_S = 0.008  # Lag of the oil spring, which counts as delay: damping over stiffness of the cylinder


def log_of(name, plant, valve=None, **changes):
    valve = {f"steering.valve.{key}": value for key, value in (valve or {}).items()}
    return run(load_scenario(name, PLANTS[plant] | valve | changes))


def rate_limit(scenario):
    flow = scenario.steering.valve.pump_flow_l_min * LITRE_PER_MINUTE
    return degrees(flow / scenario.steering.cylinder.displacement)


def check(found, scenario, plant):
    """Check that identified valve parameters agree with the scenario, and that the delay agrees to within a tick."""
    valve, late = scenario.steering.valve, LATE_OIL_S if plant == "mujoco" else 0.0
    assert found.dead_band_v == pytest.approx(valve.dead_band_v, rel=0.05)
    assert found.gain_left_l_min_v == pytest.approx(valve.gain_left_l_min_v, rel=0.03)
    assert found.gain_right_l_min_v == pytest.approx(valve.gain_right_l_min_v, rel=0.03)
    assert found.time_constant_s == pytest.approx(valve.time_constant_s, rel=0.07)
    assert found.delay_s == pytest.approx(valve.delay_s + late, abs=0.005)
    assert found.delay_s == pytest.approx(valve.delay_s, abs=TICK_S)
    assert found.explained > 0.98
    assert found.residual_rms_deg < 0.1


@pytest.fixture(scope="module")
def calm():
    return log_of("figure_eight", "bicycle", **CALM)


@pytest.fixture(scope="module")
def fitted(calm):
    """Return the valve parameters identified from the log `calm`."""
    return identify(calm.signals)


def test_valve_is_identified_from_a_noisy_figure_eight(calm, fitted):
    check(fitted, calm.scenario, "bicycle")


@pytest.mark.parametrize(("plant", "valve"), MORE)
def test_valve_is_identified_for_other_valves_and_both_plants(plant, valve):
    log = log_of("figure_eight", plant, valve, **CALM)
    check(identify(log.signals), log.scenario, plant)


@pytest.mark.parametrize(("plant", "valve"), by_turns(PLANTS, VALVES))
def test_steering_rate_limit_is_identified_from_a_run_at_the_limit(plant, valve):
    log = log_of("valve_identification", plant, valve)
    found = identify(log.signals)
    check(found, log.scenario, plant)
    assert found.rate_limit_deg_s == pytest.approx(rate_limit(log.scenario), rel=0.03)
    assert found.rate_reached_deg_s == pytest.approx(found.rate_limit_deg_s, rel=0.01)


def test_steering_rate_limit_that_was_not_reached_is_not_reported(calm, fitted):
    found = fitted
    assert found.rate_limit_deg_s is None
    assert "rate_limit_deg_s" not in found.errors
    fastest = degrees(np.abs(np.diff(calm.column("steer"))).max() / TICK_S)
    assert fastest < found.rate_reached_deg_s < rate_limit(calm.scenario)


def test_estimated_standard_errors_match_the_actual_errors(calm, fitted):
    found, valve = fitted, calm.scenario.steering.valve
    for name in ("dead_band_v", "gain_left_l_min_v", "gain_right_l_min_v", "time_constant_s", "delay_s"):
        off = abs(getattr(found, name) - getattr(valve, name))
        assert off < 5 * found.errors[name]
        assert found.errors[name] < 0.05 * getattr(valve, name)


@pytest.mark.parametrize("delay", [0.062, pytest.param(0.098, marks=pytest.mark.slow)])
def test_valve_delay_between_multiples_of_the_tick_is_identified(delay):
    log = log_of("figure_eight", "bicycle", {"delay_s": delay}, **CALM)
    assert identify(log.signals).delay_s == pytest.approx(delay, abs=0.004)


def test_identified_valve_does_not_depend_on_the_first_seconds_of_a_log(calm):
    late = calm.signals.slice(400)
    check(identify(late), calm.scenario, "bicycle")


def test_samples_at_the_steering_stops_are_omitted_from_the_fit(calm):
    """At the stops the angle does not follow the flow. The test changes the logged angle at the stops artificially."""

    def with_angle(angle):
        at = calm.signals.column_names.index("steer_measured")
        return calm.signals.set_column(at, "steer_measured", pa.array(angle))

    angle = calm.column("steer_measured").copy()
    angle[600:700] = np.radians(45.0)
    angle[700:] += 0.3
    check(identify(with_angle(angle)), calm.scenario, "bicycle")
    with pytest.raises(ScenarioError, match="stops"):
        identify(with_angle(angle + 0.8))


# --- the command --------------------------------------------------------------------------------------------------


def identified(folder):
    """Return text and JSON content of the valve identification for the run in a folder."""
    file = folder / "scenario.toml"
    found = valve(Job([folder], None, load_scenario(file if file.is_file() else "straight_line")))
    return "\n".join(found.lines), found.content


def test_valve_command_writes_json_and_prints_a_table(calm, fitted, tmp_path, call):
    write_log(calm, tmp_path / "run")
    status, text, err = call("twin", "run", "--only", "valve")
    assert (status, err) == (0, "")
    written = json.loads((tmp_path / "run" / "identified.json").read_text())
    assert written.pop("identity")
    assert written == json.loads(json.dumps(fitted._asdict()))
    assert written["rate_limit_deg_s"] is None
    rows = {line.split("|")[1].strip(): line.split("|")[2:5] for line in text.splitlines() if line.startswith("| ")}
    assert [float(cell) for cell in rows["dead_band_v"]] == pytest.approx(
        [written["dead_band_v"], written["errors"]["dead_band_v"], 0.4], rel=1e-3
    )
    assert rows["rate_limit_deg_s"][0].strip() == "not identified"
    assert "does not reach the rate limit" in text


def test_valve_command_takes_the_cylinder_from_the_scenario(tmp_path):
    log = log_of("figure_eight", "bicycle", **CALM, **{"steering.cylinder.bore_mm": 55.0, "duration_s": 70.0})
    write_log(log, tmp_path)
    _, written = identified(tmp_path)
    assert written["gain_left_l_min_v"] == pytest.approx(3.2, rel=0.03)
    assert identify(log.signals).gain_left_l_min_v > 3.5


def test_valve_is_identified_from_a_signals_file_alone(calm, tmp_path):
    pq.write_table(
        calm.signals.slice(0, 1000).select(["t", "valve_voltage", "steer_measured"]), tmp_path / "signals.parquet"
    )
    text, _ = identified(tmp_path)
    assert "dead_band_v" in text


def test_folder_without_a_run_is_rejected(calm, tmp_path):
    def refuses(match):
        with pytest.raises(ScenarioError, match=match):
            identified(tmp_path)

    with pytest.raises(ScenarioError, match="is not a folder; specify the folder of a run"):
        identified(tmp_path / "nowhere")
    refuses(r"has no signals\.parquet")
    file = tmp_path / "signals.parquet"
    file.write_text("no table")
    refuses("no column 't'")
    pq.write_table(pa.table({"t": [0.0, 0.05], "speed": [1.0, 1.0]}), file)
    refuses("no column 'valve_voltage'")
    pq.write_table(calm.signals.slice(0, 150), file)
    refuses("too short")
    n = 600
    still = {"t": 0.05 * np.arange(n), "valve_voltage": np.full(n, 6.0), "steer_measured": np.zeros(n)}
    pq.write_table(pa.table(still), file)
    refuses("the steering hardly moves")
    pq.write_table(pa.table(still | {"valve_voltage": [None] * n}), file)
    refuses("'valve_voltage' is empty in every row")


# --- signals of other origin --------------------------------------------------------------------------------------


def changed(signals, name, values):
    return signals.set_column(signals.column_names.index(name), name, values)


T = np.arange(1000) * 0.05


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("t", pa.array(np.zeros(1000)), "'t' is constant"),
        ("t", pa.array(-T), "'t' decreases at row 2"),
        ("t", pa.array(np.r_[T[:-1], np.nan]), "'t' is not a number in row 1000"),
        ("t", pa.array([None] * 1000, pa.float64()), "'t' is not a number in row 1"),
        ("t", pa.array(1000 * T), "'t' has steps of 50 s, which indicates milliseconds"),
        ("t", pa.array(20 * T), "'t': rows must be 0.001 to 0.5 s apart, got 1 s; check the unit"),
        ("t", pa.array(np.r_[T[:500], T[500:] + 60]), "'t': rows must be evenly spaced"),
        ("steer_measured", pa.array(["left"] * 1000), "'steer_measured' contains text ('left' in row 1)"),
        ("steer_measured", pa.array([[0.1]] * 1000), "'steer_measured' contains list<"),
        ("valve_voltage", pa.array([None] * 1000, pa.float64()), "gaps in valve_voltage"),
        ("valve_voltage", pa.array(6 + np.random.default_rng(3).normal(size=1000)), "the valve is not identifiable"),
    ],
)
def test_error_for_an_unusable_log_names_the_columns(calm, tmp_path, name, values, said):
    pq.write_table(changed(calm.signals.slice(0, 1000), name, values), tmp_path / "signals.parquet")
    with pytest.raises(ScenarioError) as refused:
        identified(tmp_path)
    assert str(refused.value).startswith(f"{tmp_path / 'signals.parquet'}: ")
    assert said in str(refused.value)


def test_date_time_stamps_are_accepted_as_time_column(calm, fitted):
    stamps = pa.array((1e9 * calm.signals["t"].to_numpy()).round().astype("datetime64[ns]"))
    assert identify(changed(calm.signals, "t", stamps)).dead_band_v == pytest.approx(fitted.dead_band_v)


def test_duplicate_columns_and_too_many_rows_are_reported(calm, tmp_path, monkeypatch):
    twice = calm.signals.append_column("t", calm.signals["t"])
    with pytest.raises(ScenarioError, match="there is more than one column 't'"):
        identify(twice)
    monkeypatch.setattr(fieldlog, "MOST_ROWS", 100)
    pq.write_table(calm.signals, tmp_path / "signals.parquet")
    monkeypatch.setattr(fieldlog.pq, "read_table", lambda *_, **__: pytest.fail("read all the same"))
    with pytest.raises(ScenarioError, match="rows, but the limit is 100"):
        identify(tmp_path / "signals.parquet")


def test_error_for_a_damaged_signals_file_names_the_file(calm, tmp_path):
    file = tmp_path / "signals.parquet"
    pq.write_table(calm.signals, file, compression="snappy", use_dictionary=False)
    content = bytearray(file.read_bytes())
    content[200:20_000] = bytes(255 - byte for byte in content[200:20_000])
    file.write_bytes(content)
    with pytest.raises(ScenarioError, match=r"signals.parquet: ('\w+' cannot be read|is not a valid Parquet file)"):
        identified(tmp_path)


@pytest.mark.parametrize("plant", [pytest.param("bicycle", marks=pytest.mark.slow), "mujoco"])
def test_backlash_of_one_degree_is_identified(plant):
    """The run is the library's backlash scenario; the valve parameters are identified as well."""
    scenario = load_scenario("steering_backlash", {"plant.kind": plant})
    found = identify(run(scenario).signals, scenario.steering.cylinder)
    assert found.backlash_deg == pytest.approx(1.0, abs=0.1)
    assert found.errors["backlash_deg"] < 0.05
    assert found.dead_band_v == pytest.approx(0.4, abs=0.02)
    assert found.gain_left_l_min_v == pytest.approx(0.24, rel=0.03)
    assert found.explained > 0.99


def test_linkage_without_backlash_gives_zero_backlash(fitted):
    """The identified backlash of a run of either plant is at most the wind-up of the oil column under friction."""
    assert (fitted.backlash_deg or 0.0) < 0.1
