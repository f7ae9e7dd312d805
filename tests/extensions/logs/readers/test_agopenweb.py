"""Recorder of AgOpenWeb: rows in the formats of its method `ExportCsv` (commit ef18a148)."""

from math import cos, radians, sin

import numpy as np
import pytest

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.readers import open_log
from agrobot_mj.extensions.logs.recording import read_recording

COLUMNS = (
    "timestamp,easting,northing,heading,speed,fix,roll,tool_e,tool_n,tool_h_rad,steer_angle,xte,has_guidance,"
    "paths_away,autosteer,yt_triggered,yt_executing,headland_dist,goal_e,goal_n,goal_dist,forward_dot,A,B,ptCount,"
    "is_turn_left,anti_tangent_guard_fired"
)
RADIUS, SPEED = 10.0, 2.0


def row(k):
    """Return row `k` of a log at 10 Hz on a circle to the right, across midnight. From 5 to 6 s there is no fix."""
    turned, second = SPEED / RADIUS * k / 10, 40 + k // 10
    clock = f"{'23:59' if second < 60 else '00:00'}:{second % 60:02d}.{k % 10}00"
    east, north, fix = RADIUS * (1 - cos(turned)), RADIUS * sin(turned), 0 if 50 <= k < 60 else 4
    guided = k < 390
    goal = f"{east + 1:.3f},{north:.3f},1.000,0.500" if guided else ",,,"
    place = f"{east:.3f},{north:.3f},{np.degrees(turned) % 360:.2f},{SPEED:.2f},{fix},1.50,0.000,0.000,0.0000"
    return f"{clock},{place},{14.0 if guided else 0:.3f},0.0500,{int(guided)},3,1,0,0,,{goal},12,13,0,0,0"


@pytest.fixture
def recorded(tmp_path):
    """Return a file with the columns of the debug dump, but another name: the reader recognises the columns."""
    file = tmp_path / "dump of Monday"
    file.write_text("\r\n".join([COLUMNS, *map(row, range(400)), ""]), newline="")
    return file


def test_rows_of_an_agopenweb_log_are_converted_to_quantities(recorded):
    log = open_log(recorded)
    column = {name: log.source[name].to_numpy(zero_copy_only=False) for name in log.source.column_names}
    turned = SPEED / RADIUS * 0.1 * np.arange(400)
    fixed = np.isfinite(column["east"])
    assert (log.reader, log.notes) == ("agopenweb", ())
    assert column["t"] == pytest.approx(0.1 * np.arange(400), abs=1e-6)
    assert fixed.sum() == 390
    assert column["east"][fixed] == pytest.approx((RADIUS * (1 - np.cos(turned)))[fixed], abs=6e-4)
    heading = np.unwrap(column["heading"][fixed])
    assert heading == pytest.approx(np.pi / 2 - turned[fixed], abs=1e-4)
    assert column["roll"][fixed] == pytest.approx(radians(1.5)), "right side down is left side up"
    assert set(column["quality"]) == {0, 4}
    assert column["steer_demand"][:390] == pytest.approx(-radians(14))
    assert np.isnan(column["steer_demand"][390:]).all()


def test_steering_demand_replaces_the_wheel_angle_if_mapped(recorded):
    log = open_log(recorded)
    with pytest.raises(
        FieldLogError, match=r"^dump of Monday: the log has no wheel angle; .* can use column steer_demand"
    ):
        log.checked_map()
    tables = log.tables | {"steer": {"column": "steer_demand", "unit": "rad"}}
    found = read_recording(log.source, LogMap.model_validate(tables), antenna_height=2.0)
    assert found.arm == (0.0, 0.0, 0.0), "position of the rear axle, on the ground"
    assert np.median(found.yaw_rate.value) == pytest.approx(-SPEED / RADIUS, rel=0.01)
    assert found.steer.value == pytest.approx(-radians(14))


def test_number_with_hundreds_of_digits_is_a_missing_value(recorded):
    lines = recorded.read_text().splitlines()
    lines[30] = lines[30].replace(",4,1.50,", f",{'7' * 320},1.50,")
    recorded.write_text("\n".join(lines))
    log = open_log(recorded)
    assert len(log.source) == 400


def test_logs_with_fewer_or_additional_columns_are_read(recorded, tmp_path):
    lines = recorded.read_text().splitlines()
    fewer = [",".join(line.split(",")[:11]) for line in lines]
    (tmp_path / "fewer").write_text("\n".join(fewer))
    more = [f"{line},{'new' if line == COLUMNS else 'x'}" for line in lines]
    (tmp_path / "more").write_text("\n".join(more))
    for name in ("fewer", "more"):
        log = open_log(tmp_path / name)
        assert (log.reader, len(log.source), log.notes) == ("agopenweb", 400, ())


def test_rows_after_a_decrease_of_time_are_a_new_segment(recorded):
    lines = [line for line in recorded.read_text().splitlines() if line]
    recorded.write_text("\n".join([lines[0], *lines[100:190], *lines[1:9]]))
    log = open_log(recorded)
    assert log.notes[0] == "the time decreases by 18.8 s; the following rows are a new segment"
    assert np.diff(log.source["t"].to_numpy()).max() == pytest.approx(60.0, abs=0.1)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda lines: lines[:1], "contains no rows"),
        (lambda lines: [lines[0], *[line[:40] for line in lines[1:]]], "400 of 400 lines cannot be read"),
        (lambda lines: [lines[0], *[line.replace(".", ",") for line in lines[1:]]], "lines cannot be read"),
    ],
)
def test_damaged_agopenweb_files_are_rejected_with_the_reason(recorded, change, told):
    recorded.write_text("\n".join(change([line for line in recorded.read_text().splitlines() if line])))
    with pytest.raises(FieldLogError, match=told):
        open_log(recorded)
