"""Recordings are cut where they say nothing, and a speed without sign gets one."""

import numpy as np
import pyarrow as pa
import pytest

from agrobot_mj.fieldlogs.columns import FieldLogError
from agrobot_mj.fieldlogs.maps import LogMap
from agrobot_mj.fieldlogs.pieces import check_columns, pieces, split
from agrobot_mj.fieldlogs.recording import read_recording

MAP = {
    "time": {"column": "t"},
    "steer": {"column": "steer"},
    "speed": {"column": "speed"},
    "heading": {"column": "heading", "convention": "enu"},
    "position": {"east": "x", "north": "y"},
}


def shunt(turned=0.0, heading=True, offset=(0.0, 0.0)):
    """Forward for 30 s, back for 10 s round a bend, forward again, at 20 Hz with fixes at 10 Hz, then 5 s of rest."""
    t = np.arange(0, 75, 0.05)
    speed = np.interp(t, [0, 3, 5, 28, 30, 30.5, 32, 40, 41, 43, 69, 70, 75], [0, 0, 2, 2, 0, 0, -1, -1, 0, 2, 2, 0, 0])
    yaw = np.cumsum(0.12 * speed * np.sin(t / 5)) * 0.05
    rng = np.random.default_rng(1)
    x, y = (np.cumsum(speed * each) * 0.05 + 0.01 * rng.standard_normal(len(t)) for each in (np.cos(yaw), np.sin(yaw)))
    late = 2 * (np.arange(len(t)) // 2)
    columns = {"t": t, "steer": np.degrees(0.17 * np.sin(t / 5)), "speed": np.abs(speed), "x": x[late], "y": y[late]}
    m = dict(MAP)
    if heading:
        columns["heading"] = np.degrees(yaw) + turned
    else:
        del m["heading"]
    return speed, columns, LogMap.model_validate(m)


def read(columns, log_map):
    return read_recording(pa.table(columns), log_map, 2.0)


@pytest.mark.parametrize("turned", [0.0, 90.0, 180.0])
@pytest.mark.parametrize("heading", [True, False])
def test_legs_in_reverse_are_found(turned, heading):
    """Also where the antennas stand across the machine, or there is one only."""
    speed, columns, log_map = shunt(turned, heading)
    found = pieces([read(columns, log_map)])
    (kept,) = found.kept
    fast = np.abs(speed) > 0.2
    assert np.sign(kept.speed.value[fast]) == pytest.approx(np.sign(speed[fast]))
    assert any("the speed has no sign" in note for note in found.notes)
    assert any("deg off the course" in note for note in found.notes) == (heading and turned > 0)


def test_a_speed_with_a_sign_is_believed():
    speed, columns, log_map = shunt()
    found = pieces([read(columns | {"speed": speed}, log_map)])
    assert found.kept[0].speed.value == pytest.approx(speed)
    assert not any("no sign" in note for note in found.notes)


def test_standstill_gaps_and_frozen_positions_are_left_out():
    _, columns, log_map = shunt()
    t = columns["t"]
    for name in ("x", "y"):
        columns[name] = np.where((t > 10) & (t < 14), columns[name][200], columns[name])
    columns["steer"] = np.where((t > 50) & (t < 52), np.nan, columns["steer"])
    found = pieces([read(columns, log_map)])
    spans = [(each.start, each.end) for each in found.kept]
    expected = [(3.1, 10.0), (14.0, 50.0), (52.0, 69.9)]
    assert np.array(spans) == pytest.approx(np.array(expected), abs=0.2)
    assert "3.1" in found.notes[0]
    for why in ("standing", "no position 4.", "gap in 'steer' 2."):
        assert why in found.notes[0]


def test_several_logs_share_out_by_time():
    _, columns, log_map = shunt()
    recordings = [read(columns, log_map)] * 2
    kept = pieces(recordings, 5.0, 65.0).kept
    assert [each.end - each.start for each in kept] == pytest.approx([60.0, 60.0], abs=0.1)
    first, second = split(kept, 0.75)
    assert [each.end - each.start for each in first] == pytest.approx([60.0, 30.0], abs=0.1)
    assert [each.end - each.start for each in second] == pytest.approx([30.0], abs=0.1)


def test_a_log_that_stands_says_so():
    _, columns, log_map = shunt()
    with pytest.raises(FieldLogError, match=r"0 of 3 s kept; left out: standing .* take a log that drives"):
        pieces([read(columns, log_map)], 0.0, 3.0)


def test_words_and_booleans_are_qualities():
    _, columns, log_map = shunt()
    n = len(columns["t"])
    columns |= {"fix": ["fixed"] * 300 + ["float"] * (n - 300), "ok": [False] * 100 + [True] * (n - 100)}
    tables = log_map.model_dump(exclude_none=True)
    tables["position"] |= {"quality": "fix", "accepted": ("fixed", 4)}
    tables["heading"] |= {"quality": "ok"}
    found = read(columns, LogMap.model_validate(tables))
    assert found.position.t.max() < columns["t"][300]
    assert found.heading.t.min() >= columns["t"][100]


@pytest.mark.parametrize("values", [0, 1, 3])
def test_a_part_with_few_values_of_a_heading_has_none(values):
    """A log whose receiver found its heading late is still replayed by the rest, not interpolated through a value."""
    _, columns, log_map = shunt()
    late = np.arange(len(columns["t"])) >= 200 - values
    columns["heading"] = np.where(late, columns["heading"], np.nan)
    part = read(columns, log_map).between(5.0, 9.97)
    assert part.heading is None
    assert part.position is not None
    assert read(columns, log_map).between(5.0, 10.5).heading is not None


def test_a_speed_in_another_unit_than_the_positions_is_refused():
    _, columns, log_map = shunt()
    with pytest.raises(FieldLogError, match=r"its positions move by \d+ m, its speed makes \d+ m; check the unit"):
        check_columns(pieces([read(columns | {"speed": columns["speed"] / 3.6}, log_map)]).kept)


def test_east_for_north_is_refused_where_the_heading_shows_it():
    _, columns, log_map = shunt()
    with pytest.raises(FieldLogError, match=r"positions turn right where its heading turns left; are the columns of"):
        check_columns(pieces([read(columns | {"x": columns["y"], "y": columns["x"]}, log_map)]).kept)


def test_a_log_without_positions_is_kept_as_it_is():
    _, columns, log_map = shunt()
    found = pieces([read(columns, log_map.model_copy(update={"position": None}))], 5.0, 65.0)
    assert [(each.start, each.end) for each in found.kept] == [pytest.approx((5.0, 65.0))]
    assert "60 of 60 s kept" in found.notes[0]
    assert len(found.notes) == 1
    check_columns(found.kept)


def test_a_log_from_the_middle_of_a_drive_agrees_with_its_positions():
    """40 s at 0.5 m/s, then 20 s at 5 m/s: the speed at each time makes the way."""
    t = np.arange(0, 60, 0.1)
    speed = np.interp(t, [0, 39.5, 40.5, 60], [0.5, 0.5, 5, 5])
    driven = np.cumsum(speed) * 0.1
    columns = {"t": t, "steer": 0 * t, "speed": speed, "heading": 0 * t + 30}
    places = {"x": driven * np.cos(np.pi / 6), "y": driven * np.sin(np.pi / 6)}
    (kept,) = pieces([read(columns | places, LogMap.model_validate(MAP))]).kept
    assert (kept.start, kept.end) == pytest.approx((0.0, 59.9))
    check_columns([kept])
