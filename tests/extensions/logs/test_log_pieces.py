"""Division of recordings into usable segments, and the sign of an unsigned speed."""

import numpy as np
import pyarrow as pa
import pytest
from field_logs import STEP_S, field_log, path, recorded

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.checks import check_columns
from agrobot_mj.extensions.logs.direction import LEAST_LEG_M, by_course
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.pieces import pieces, split_at
from agrobot_mj.extensions.logs.recording import read_recording
from agrobot_mj.extensions.logs.series import TimeSeries, turned_headings

MAP = {
    "time": {"column": "t"},
    "steer": {"column": "steer"},
    "speed": {"column": "speed"},
    "heading": {"column": "heading", "convention": "enu"},
    "position": {"east": "x", "north": "y"},
}


def shunt(turned=0.0, heading=True, offset=(0.0, 0.0)):
    """Return a log at 20 Hz: forward for 30 s, reverse in a bend for 10 s, forward again, and 5 s at rest."""
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
def test_reverse_segments_are_found_with_unsigned_speed(turned, heading):
    """Cases include two antennas across the machine and a single antenna."""
    speed, columns, log_map = shunt(turned, heading)
    found = pieces([read(columns, log_map)])
    (kept,) = found.kept
    fast = np.abs(speed) > 0.2
    assert np.sign(kept.speed.value[fast]) == pytest.approx(np.sign(speed[fast]))
    assert any("the speed has no sign" in note for note in found.notes)
    assert any("deg off the course" in note for note in found.notes) == (heading and turned > 0)


def test_displacements_of_a_reverse_segment_have_a_negative_sign():
    forward = 0.5 * LEAST_LEG_M * np.repeat([1.0, -1.0, 1.0], [8, 4, 6])
    assert by_course(forward * np.exp(0.7j), LEAST_LEG_M) == pytest.approx(forward)


def test_speed_with_a_sign_is_used_unchanged():
    speed, columns, log_map = shunt()
    found = pieces([read(columns | {"speed": speed}, log_map)])
    assert found.kept[0].speed.value == pytest.approx(speed)
    assert not any("no sign" in note for note in found.notes)


def test_standstill_data_gaps_and_frozen_positions_are_omitted():
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
    for why in ("standstill", "no position 4.", "gap in 'steer' 2."):
        assert why in found.notes[0]


def test_recordings_of_several_logs_are_split_at_a_fraction_of_their_time():
    _, columns, log_map = shunt()
    recordings = [read(columns, log_map)] * 2
    kept = pieces(recordings, 5.0, 65.0).kept
    assert [each.end - each.start for each in kept] == pytest.approx([60.0, 60.0], abs=0.1)
    first, second = split_at(kept, 0.75)
    assert [each.end - each.start for each in first] == pytest.approx([60.0, 30.0], abs=0.1)
    assert [each.end - each.start for each in second] == pytest.approx([30.0], abs=0.1)


def test_log_recorded_at_standstill_is_reported():
    _, columns, log_map = shunt()
    with pytest.raises(
        FieldLogError,
        match=r"0 of 3 s are used; omitted: standstill .* use a log with more time in "
        r"motion",
    ):
        pieces([read(columns, log_map)], 0.0, 3.0)


def test_fix_quality_column_may_contain_words_or_booleans():
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
def test_heading_of_a_segment_with_few_heading_values_is_omitted(values):
    """The other signals of a log whose receiver found its heading late are still replayed; the heading is not
    interpolated."""
    _, columns, log_map = shunt()
    late = np.arange(len(columns["t"])) >= 200 - values
    columns["heading"] = np.where(late, columns["heading"], np.nan)
    part = read(columns, log_map).between(5.0, 9.97)
    assert part.heading is None
    assert part.position is not None
    assert read(columns, log_map).between(5.0, 10.5).heading is not None


def test_speed_inconsistent_with_the_positions_is_rejected():
    _, columns, log_map = shunt()
    with pytest.raises(
        FieldLogError,
        match=r"the positions cover \d+ m, but the speed gives \d+ m; check "
        r"the unit",
    ):
        check_columns(pieces([read(columns | {"speed": columns["speed"] / 3.6}, log_map)]).kept)


def test_comparison_with_the_heading_rejects_swapped_position_axes():
    _, columns, log_map = shunt()
    with pytest.raises(
        FieldLogError,
        match=r"positions turns right where the heading turns left; check whether the "
        r"east and north columns of",
    ):
        check_columns(pieces([read(columns | {"x": columns["y"], "y": columns["x"]}, log_map)]).kept)


def test_mirrored_heading_is_rejected_in_a_log_with_a_gyro():
    driven = path()
    columns = field_log(driven) | {"gyro": np.degrees(np.gradient(driven[5], STEP_S))[::5]}
    check_columns([recorded(columns, yaw_rate={"column": "gyro"})])
    mirrored = recorded(columns, yaw_rate={"column": "gyro"}, heading={"convention": "compass"})
    with pytest.raises(FieldLogError, match=r"where the heading turns left; .* change heading\.convention in the map"):
        check_columns([mirrored])


def test_log_without_positions_is_not_divided_into_segments():
    _, columns, log_map = shunt()
    found = pieces([read(columns, log_map.model_copy(update={"position": None}))], 5.0, 65.0)
    assert [(each.start, each.end) for each in found.kept] == [pytest.approx((5.0, 65.0))]
    assert "60 of 60 s are used" in found.notes[0]
    assert len(found.notes) == 1
    check_columns(found.kept)


def test_segment_that_starts_in_motion_keeps_its_speed_and_positions():
    """The driven distance is the integral of 0.5 m/s for 40 s and of 5 m/s for 20 s."""
    t = np.arange(0, 60, 0.1)
    speed = np.interp(t, [0, 39.5, 40.5, 60], [0.5, 0.5, 5, 5])
    driven = np.cumsum(speed) * 0.1
    columns = {"t": t, "steer": 0 * t, "speed": speed, "heading": 30 + 0.01 * np.sin(t)}
    places = {"x": driven * np.cos(np.pi / 6), "y": driven * np.sin(np.pi / 6)}
    (kept,) = pieces([read(columns | places, LogMap.model_validate(MAP))]).kept
    assert (kept.start, kept.end) == pytest.approx((0.0, 59.9))
    check_columns([kept])


def left_out(columns, log_map):
    """Return the remaining log and the omitted positions."""
    found = pieces([read(columns, log_map)])
    told = [note for note in found.notes if "positions that jump" in note]
    return found, int(told[0].split(": ")[1].split()[0]) if told else 0


@pytest.mark.parametrize("heading", [True, False])
def test_positions_that_jump_away_and_back_are_omitted(heading):
    """One fix, three successive fixes, or two successive fixes at different positions are omitted; all others are
    unchanged."""
    _, columns, log_map = shunt(heading=heading)
    (clean,) = pieces([read(columns, log_map)]).kept
    x, y = columns["x"].copy(), columns["y"].copy()
    for first, fixes, (east, north) in ((300, 1, (0, 2)), (500, 3, (-40, 3)), (900, 1, (3, 0)), (902, 1, (0, -3))):
        x[first : first + 2 * fixes] += east
        y[first : first + 2 * fixes] += north
    found, jumps = left_out(columns | {"x": x, "y": y}, log_map)
    assert jumps == 6
    (kept,) = found.kept
    assert np.isin(kept.position.value[:, 0], clean.position.value[:, 0]).all()
    assert len(kept.position.t) == len(clean.position.t) - 6
    assert kept.speed.value == pytest.approx(clean.speed.value)
    if not heading:
        same = np.isin(clean.yaw_rate.t, kept.yaw_rate.t)
        apart = np.abs(kept.yaw_rate.value - clean.yaw_rate.value[same])
        assert np.degrees(apart.max()) < 5.0, "three fixes are bridged by a line"


def test_permanent_position_jump_divides_a_log_into_segments():
    """A new base station shifts positions by 1.2 m. Both segments exclude the jump, which is not a turn."""
    _, columns, log_map = shunt(heading=False)
    (clean,) = pieces([read(columns, log_map)]).kept
    moved = {"x": columns["x"] + 1.2 * (columns["t"] > 20.05)}
    found, jumps = left_out(columns | moved, log_map)
    assert [(each.start, each.end) for each in found.kept] == [
        pytest.approx((clean.start, 19.0), abs=0.2),
        pytest.approx((21.1, clean.end), abs=0.2),
    ]
    assert 15 <= jumps <= 25
    for each in found.kept:
        rate = np.interp(each.yaw_rate.t, clean.yaw_rate.t, clean.yaw_rate.value)
        assert np.degrees(np.abs(each.yaw_rate.value - rate).max()) < 0.5


def test_noise_fast_turns_and_wrong_units_are_not_position_jumps():
    speed, columns, log_map = shunt()
    rng = np.random.default_rng(2)
    noisy = {name: columns[name] + np.repeat(0.3 * rng.standard_normal(750), 2) for name in "xy"}
    for told in (noisy, {"speed": np.abs(speed) / 3.6}, {"speed": 3.6 * np.abs(speed)}):
        assert left_out(columns | told, log_map)[1] == 0


def test_implausible_positions_are_rejected():
    _, columns, log_map = shunt()
    places = np.repeat(np.random.default_rng(3).integers(0, 2, 750), 2)
    with pytest.raises(FieldLogError, match=r"\d+ of \d+ positions in 'x' and 'y' are farther apart than the speed"):
        read(columns | {"x": columns["x"] + 20 * (places * (columns["t"] % 3 < 2))}, log_map)


def test_fit_rejects_a_position_rate_of_one_per_second():
    _, columns, log_map = shunt()
    slow = 20 * (np.arange(len(columns["t"])) // 20)
    found = pieces([read(columns | {name: columns[name][slow] for name in "xy"}, log_map)])
    with pytest.raises(
        FieldLogError,
        match=r"the rate of \[position\] is 1 Hz, but a fit needs 2.5 Hz; log every "
        r"value",
    ):
        check_columns(found.kept)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"heading": lambda values: 0 * values + 30.0}, r"\[heading\] is constant; specify another column, or remove"),
        (
            {"speed": lambda values: np.round(values * 3.6) / 3.6},
            r"the resolution of \[speed\] is 0.28 m/s, too low",
        ),
    ],
)
def test_fit_rejects_constant_and_coarsely_quantised_sensors(change, told):
    _, columns, log_map = shunt()
    columns |= {name: made(columns[name]) for name, made in change.items()}
    with pytest.raises(FieldLogError, match=told):
        check_columns(pieces([read(columns, log_map)]).kept)


@pytest.mark.parametrize("seconds", [0.2, 3.0])
def test_temporarily_reversed_heading_is_omitted(seconds):
    """The receiver has exchanged its two antennas; the tractor does not reverse."""
    _, columns, log_map = shunt()
    clean, turned = read(columns, log_map), (columns["t"] > 15.02) & (columns["t"] < 15.02 + seconds)
    found = read(columns | {"heading": columns["heading"] + 180.0 * turned}, log_map)
    assert found.notes == (f"{turned.sum()} values of 'heading' that jump or are next to a jump are omitted",)
    same = np.isin(clean.heading.t, found.heading.t)
    assert (~same).sum() == turned.sum()
    assert found.heading.value == pytest.approx(clean.heading.value[same])


@pytest.mark.parametrize("points", ["east", "turning"])
def test_normal_heading_changes_are_not_reported_as_jumps(points):
    t = np.arange(0, 60, 0.2)
    yaw = 2.9 * t if points == "turning" else 0.5 * np.sin(2 * t)
    found = turned_headings(TimeSeries(t, yaw))
    assert (found.t == t).all()
