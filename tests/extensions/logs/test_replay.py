"""Replay of a simulated recording: on the same plant only sensor noise remains, on another plant more."""

import json
from math import degrees, radians

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.agopengps.messages import SteerState
from agrobot_mj.core.agopengps.position import BoardAttitude, paogi
from agrobot_mj.core.agopengps.traffic import Datagram, Traffic
from agrobot_mj.core.agopengps.wire import encode
from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.core.nmea import Solution
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.maps import read_map
from agrobot_mj.extensions.logs.readers import open_log
from agrobot_mj.extensions.logs.replay.residuals import rigid
from agrobot_mj.extensions.logs.replay.result import COLUMNS, replay
from agrobot_mj.extensions.logs.words import doubts, replay_sentences
from agrobot_mj.simulation.storage import write_log


def summary(found, tractor):
    """Return the printed text of a replay."""
    return "\n".join(replay_sentences(found, tractor))


MAP = """
[time]
column = "ms"
unit = "ms"
[steer]
column = "angle"
positive = "right"
offset = 2.5
delay_s = 0.025
averaged_s = 0.05
[speed]
column = "kmh"
unit = "km/h"
[yaw_rate]
column = "turning"
positive = "right"
[position]
latitude = "lat"
longitude = "lon"
quality = "fix"
origin_lat_deg = 51.0
origin_lon_deg = 4.0
"""


@pytest.fixture(scope="module")
def driven():
    keys = {"plant.kind": "bicycle", "sensors.gyro.enabled": True, "duration_s": 30, "controller.kind": "pd"}
    return run(load_scenario("figure_eight", keys))


def as_csv(log, file, **changes):
    """Write the log with other names, units and signs, and with an additional text column."""
    x, y = log.column("gnss_x"), log.column("gnss_y")
    places = [to_geodetic(Origin(51.0, 4.0), *p) for p in zip(x, y, strict=True)]
    columns = {
        "ms": 1e3 * log.column("t") + 1e6,
        "angle": -np.degrees(log.column("steer_measured")) + 2.5,
        "kmh": 3.6 * log.column("speed_hat"),
        "turning": -np.degrees(log.column("gyro")),
        "lat": [p[0] for p in places],
        "lon": [p[1] for p in places],
        "fix": 2 * log.column("gnss_quality"),
        "note": ["row"] * len(x),
    }
    pacsv.write_csv(pa.table(columns | changes), file)
    return file


# --- residuals ----------------------------------------------------------------------------------------------------


def test_replay_with_the_true_plant_leaves_only_sensor_noise(driven):
    found = replay(driven.signals, None, driven.scenario).metrics
    assert found["outcome"] == "completed"
    assert found["speed_rms"] < 0.01
    assert degrees(found["steer_rms"]) < 0.01
    # 0.1 deg/s of the gyro, and 0.06 deg of the potentiometer at 1.2 m/s over 1.4 m
    assert degrees(found["yaw_rate"]["rms"]) == pytest.approx(0.12, abs=0.03)
    assert found["yaw_rate"]["explained"] > 0.99
    assert abs(found["yaw_rate"]["lag_s"]) < 0.02
    assert found["position"]["windows_rms"] < 0.03
    assert found["position"]["rms"] < 0.1


def test_replay_from_the_middle_of_a_log_starts_at_its_speed(driven):
    found = replay(driven.signals, None, driven.scenario, start_s=12.3)
    ((recording, plant),) = found.pieces
    assert plant.speed[0] == pytest.approx(recording.speed.at(plant.t[:1])[0], abs=0.01)
    assert plant.t[0] == pytest.approx(12.3, abs=0.06)
    assert found.metrics["position"]["rms"] < 0.15
    assert degrees(found.metrics["yaw_rate"]["rms"]) < 0.16


def test_replayed_valve_has_the_delay_and_dead_band_of_the_log(driven):
    found = replay(driven.signals, None, driven.scenario, by="valve").metrics
    assert degrees(found["steer_rms"]) < 0.3
    other = replay(driven.signals, None, driven.scenario.changed({"steering.valve.dead_band_v": 0.8}), by="valve")
    assert other.metrics["steer_rms"] > 5 * found["steer_rms"]


def test_replay_with_another_tractor_has_larger_residuals(driven):
    """Soft front tyres understeer by 4 % at 1.2 m/s."""
    soft = driven.scenario.changed({"plant.front_cornering_stiffness_n_rad": 4000.0})
    found, right = replay(driven.signals, None, soft).metrics, replay(driven.signals, None, driven.scenario).metrics
    assert found["yaw_rate"]["lag_s"] < right["yaw_rate"]["lag_s"] - 0.05
    assert found["yaw_rate"]["rms_without_bias"] > 1.3 * right["yaw_rate"]["rms_without_bias"]


def with_column(table, name, values):
    return table.set_column(table.column_names.index(name), name, pa.array(values))


@pytest.mark.parametrize("scale", [-1.0, radians(1.0)])
def test_steering_column_with_wrong_sign_or_unit_is_reported(driven, scale):
    right = replay(driven.signals, None, driven.scenario)
    turned = with_column(driven.signals, "steer_measured", scale * driven.column("steer_measured"))
    found = replay(turned, None, driven.scenario)
    assert "does not explain" not in summary(right, driven.scenario.tractor)
    assert "does not explain the recorded yaw rate: check sign (positive) and unit of [steer]" in summary(
        found, driven.scenario.tractor
    )


@pytest.mark.parametrize(
    ("reads", "scaled", "said"),
    [
        (0.9, False, "tractor.wheelbase_m or, at high speed, the tyre parameters are wrong"),
        (1.1, True, "the scale of [steer] is calibrated, so the tyre parameters are probably wrong"),
        (0.9, True, "a model without slip has a smaller residual"),
    ],
)
def test_calibrated_steering_scale_is_not_reported_as_suspect(driven, reads, scaled, said):
    """The real machine turns more than its plant because its tyres slip less."""
    turned = with_column(driven.signals, "steer_measured", reads * driven.column("steer_measured"))
    lines = doubts(replay(turned, None, driven.scenario), driven.scenario.tractor, scaled)
    (line,) = [each for each in lines if each.startswith(f"The machine turns {1 / reads:.1f}")]
    assert said in line
    assert ("measure the wheelbase" in line) is not scaled


def test_wrong_speed_unit_is_detected_from_the_track_length(driven):
    slow = replay(with_column(driven.signals, "speed_hat", driven.column("speed_hat") / 1.609), None, driven.scenario)
    assert slow.metrics["position"]["stretch"] == pytest.approx(1.609, rel=0.01)
    assert "times as long as the track of the plant: check the unit of [speed]" in summary(
        slow, driven.scenario.tractor
    )


def test_track_length_ratio_does_not_depend_on_steering_errors(driven):
    other = replay(with_column(driven.signals, "steer_measured", -4 * driven.column("steer")), None, driven.scenario)
    assert other.metrics["position"]["windows_rms"] > 0.2
    assert other.metrics["position"]["stretch"] == pytest.approx(1.0, abs=0.01)
    assert "times as long" not in summary(replay(driven.signals, None, driven.scenario), driven.scenario.tractor)


def test_log_with_constant_positions_is_rejected(driven):
    still = with_column(driven.signals, "gnss_x", np.zeros(driven.signals.num_rows))
    still = with_column(still, "gnss_y", np.zeros(driven.signals.num_rows))
    with pytest.raises(FieldLogError, match="'gnss_x' and 'gnss_y' are constant; specify other columns"):
        replay(still, None, driven.scenario)


@pytest.mark.parametrize("offset", [499_300.0, 1e99])  # larger numbers count as missing
def test_error_for_projected_coordinates_names_the_origin_keys(driven, offset):
    far = with_column(driven.signals, "gnss_x", driven.column("gnss_x") + offset)
    with pytest.raises(
        FieldLogError, match=r"set position\.origin_east_m = [\d.e+]+ and position\.origin_north_m"
    ) as told:
        replay(far, None, driven.scenario)
    assert len(str(told.value)) < 250


def test_antenna_tilt_on_a_slope_is_included_in_the_replay():
    keys = {"duration_s": 14, "controller.kind": "pd", "plant.tyre.kind": "magic_formula"}
    log = run(load_scenario("side_slope_10", keys))
    found = replay(log.signals, None, log.scenario)
    assert found.metrics["position"]["rms"] < 0.1
    assert degrees(found.metrics["steer_rms"]) < 0.2
    # a point without height stands 35 cm beside that antenna; only the map's height tells them apart
    middle = np.hypot(*(found.pieces[0][1].point[0] - [log.column("rear_x")[0], log.column("rear_y")[0]]))
    assert middle == pytest.approx(2.0 * np.sin(radians(10)), abs=0.05)


def test_rigid_motion_between_two_point_sets_is_recovered():
    points = np.random.default_rng(1).standard_normal((50, 2))
    c, s = np.cos(0.7), np.sin(0.7)
    moved = points @ np.array([[c, s], [-s, c]]) + [3.0, -2.0]
    found = rigid(points, moved)
    assert found.turn == pytest.approx(0.7)
    assert found.of(points) == pytest.approx(moved)


# --- maps ---------------------------------------------------------------------------------------------------------


def test_csv_in_other_units_gives_the_same_replay_metrics(driven, tmp_path):
    (tmp_path / "map.toml").write_text(MAP)
    log = as_csv(driven, tmp_path / "log.csv")
    found = replay(log, read_map(tmp_path / "map.toml"), driven.scenario).metrics
    own = replay(driven.signals, None, driven.scenario).metrics
    for part, key in (("yaw_rate", "rms"), ("position", "rms"), ("position", "windows_rms")):
        assert found[part][key] == pytest.approx(own[part][key], rel=1e-3)


def test_link_recording_is_read_as_a_log(driven, tmp_path):
    traffic = Traffic()
    rows = [driven.column(name).tolist() for name in ("gnss_x", "gnss_y", "speed_hat", "yaw", "steer_measured")]
    for turn, (x, y, speed, yaw, steer) in enumerate(zip(*rows, strict=True)):
        solution = Solution(turn * TICK_S, *to_geodetic(Origin(51.0, 4.0), x, y), 2.0, speed, 0.0)
        traffic.add(Datagram(turn, 0.0, "out", "h:1", paogi(solution, BoardAttitude(yaw, 0.0, 0.0, 0.0))))
        traffic.add(Datagram(turn, 0.0, "out", "h:1", encode(SteerState(steer))))
        traffic.add(Datagram(turn, 0.0, "in", "h:1", b"anything"))
    pq.write_table(traffic.table(0), tmp_path / "link.parquet")
    log = open_log(tmp_path / "link.parquet")
    assert log.reader == "link"
    assert np.asarray(log.source["steer"]) == pytest.approx(driven.column("steer_measured"), abs=radians(0.006))
    found = replay(log.source, log.checked_map(), driven.scenario).metrics
    assert found["log"] == "link.parquet"
    assert found["yaw_rate"]["source"] == "heading"
    assert found["yaw_rate"]["explained"] > 0.95
    assert found["position"]["windows_rms"] < 0.05


def test_course_of_positions_is_used_without_gyro_and_heading(driven):
    table = driven.signals.drop_columns(["gyro"])
    found = replay(table, None, driven.scenario).metrics["yaw_rate"]
    assert found["source"] == "course"
    assert found["recorded_rms"] == pytest.approx(np.std(driven.column("yaw_rate")), rel=0.25)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("[steer]", "[stear]", "map.toml: stear: unknown key; did you mean 'steer'"),
        ('unit = "ms"', 'unit = "h"', "map.toml: time.unit: must be one of"),
        (
            'latitude = "lat"',
            "",
            "map.toml: position.latitude: specify either latitude and longitude, or east and north",
        ),
        ("[speed]", "[speed", "map.toml: not valid TOML"),
        ('column = "kmh"', 'column = "km"', "log.csv: there is no column 'km' (speed.column); did you mean 'kmh'"),
        ('column = "kmh"', 'column = "note"', "log.csv: 'note' contains text"),
        ('unit = "km/h"', 'unit = "kn"', None),
        ('unit = "ms"', 'unit = "s"', "log.csv: 'ms' has steps of 50 s, which indicates milliseconds; set time.unit"),
        ('unit = "km/h"', "scale = 100.0", "'kmh' reaches"),
        ('positive = "right"\noffset', 'unit = "rad"\noffset', "check steer.unit of the map"),
        ('quality = "fix"', 'quality = "fix"\naccepted = [7]', "contain 0 positions with 'fix' in [7]"),
    ],
)
def test_replay_command_reports_errors_in_the_map(driven, tmp_path, call, old, new, told):
    as_csv(driven, tmp_path / "log.csv")
    (tmp_path / "map.toml").write_text(MAP.replace(old, new, 1))
    status, _, err = call(
        "twin", "--only", "replay", "log.csv", "--map", "map.toml", "--set", "plant.kind=bicycle", "--out", "r", "-q"
    )
    assert status == (0 if told is None else 2)
    assert (told or "") in err
    assert "Traceback" not in err


def test_replay_of_invalid_columns_gives_exit_status_2(driven, tmp_path, call):
    (tmp_path / "map.toml").write_text(MAP)
    n = len(driven.signals)
    still = np.zeros(n)
    for changes, told in (
        ({"ms": still}, "'ms' is constant"),
        ({"ms": 1e3 * (driven.column("t") % 1.0)}, "'ms' decreases"),
        ({"kmh": still}, "'kmh' never reaches"),
        ({"angle": ["x"] * n}, "'angle' contains text"),
        ({"angle": [None] * n}, "'angle' is empty in every row"),
    ):
        as_csv(driven, tmp_path / "log.csv", **changes)
        status, _, err = call("twin", "--only", "replay", "log.csv", "--map", "map.toml", "--set", "plant.kind=bicycle")
        assert (status, told in err) == (2, True), err


def test_error_for_a_log_of_unknown_columns_requests_a_map(tmp_path, call):
    pq.write_table(pa.table({"a": [1.0, 2.0]}), tmp_path / "log.parquet")
    status, _, err = call("twin", "--only", "replay", "log.parquet")
    assert (status, "--map map.toml" in err) == (2, True)


# --- the command --------------------------------------------------------------------------------------------------


def test_replay_command_writes_metrics_signals_and_a_figure(driven, tmp_path, call):
    write_log(driven, tmp_path / "run")
    status, out, _ = call("twin", "--only", "replay", "run", "--to", "20", "--out", "r")
    assert status == 0
    assert "yaw rate by the gyro, residual rms" in out
    numbers = json.loads((tmp_path / "r" / "replay.json").read_text())
    assert numbers["duration_s"] == pytest.approx(20, abs=0.1)
    assert numbers["plant"] == "bicycle"
    table = pq.read_table(tmp_path / "r" / "replay.parquet")
    assert table.column_names == [column.name for column in COLUMNS]
    assert {field.metadata[b"unit"] for field in table.schema} <= {b"-", b"s", b"rad", b"rad/s", b"m", b"m/s"}
    assert np.nanmax(np.abs(np.asarray(table["e_left"], dtype=float))) < 0.3
    assert (tmp_path / "r" / "replay.png").stat().st_size > 10_000


def test_rollover_during_replay_gives_exit_status_1(driven, tmp_path, call):
    write_log(driven, tmp_path / "run")
    tall = (
        "--set",
        "plant.kind=mujoco",
        "--set",
        "terrain.kind=slope",
        "--set",
        "terrain.grade_deg=44",
        "--set",
        "terrain.direction_deg=90",
    )
    status, _, err = call("twin", "--only", "replay", "run", "--out", "r", "--to", "5", *tall)
    assert status == 1
    assert "rolled_over" in err
