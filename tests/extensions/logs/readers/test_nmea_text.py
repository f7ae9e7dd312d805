"""NMEA text: valid and damaged sentences of pynmeagps and of boards, across midnight and without a fix."""

from math import pi, radians

import numpy as np
import pytest

from agrobot_mj.core.table_columns import FieldLogError, read_columns
from agrobot_mj.extensions.logs.readers import open_log
from agrobot_mj.extensions.logs.readers.base import HEAD_BYTES

EAST, LATITUDE = 2.5e-5, 50.877  # Degrees of longitude a second, some 1.8 m, and latitude
MOVING = "$GPRMC,120000.10,A,5052.620,N,00441.940,E,7.5,123.5,231126,,,A"
BOARD = "$PAOGI,120000.10,5052.6200000,N,00441.9400000,E,4,14,0.7,35.000,1.0,2.333,90.00,-2.50,0.0,5.0"
"""Position sentence of the AgOpenGPS family without its checksum."""


def checked(text):
    """Return a sentence with its checksum."""
    total = 0
    for character in text[1:]:
        total ^= ord(character)
    return f"{text}*{total:02X}"


def drive(sentences=20):
    """Return the lines of a receiver that moves east."""
    return [checked(f"$GNGGA,{timed(k)},{place_of(k)},4,12,0.7,35.0,M,0.0,M,1.0,0") for k in range(sentences)]


@pytest.fixture
def written(tmp_path):
    """Write a minute of sentences at 5 Hz across midnight, after stamps of a logger, with two seconds without fix."""
    pynmeagps = pytest.importorskip("pynmeagps", reason="pynmeagps is not installed (uv sync, or make install)")

    def sentence(kind, **values):
        return pynmeagps.NMEAMessage("GN", kind, pynmeagps.GET, hpnmeamode=1, **values).serialize().decode()

    lines = []
    for k in range(300):
        hour, minute, second = (23, 59, 30 + k // 5) if k < 150 else (0, 0, (k - 150) // 5)
        lost = 100 <= k < 110
        place = {"lat": LATITUDE, "lon": 4.699 + k / 5 * EAST, "quality": 0 if lost else 4, "numSV": 14, "HDOP": 0.7}
        time = f"{hour:02d}:{minute:02d}:{second:02d}.{k % 5 * 2}"
        lines += [
            sentence("GGA", time=time, **place, alt=35.0, altUnit="M", sep=0, sepUnit="M", diffAge=1, diffStation=0),
            sentence("VTG", cogt=90.0, cogtUnit="T", sogn=3.5, sognUnit="N", sogk=6.482, sogkUnit="K", posMode="R"),
            sentence("HDT", headingT=88.5, headingTUnit="T"),
            sentence("GSA", opMode="A", navMode=3),
        ]
    file = tmp_path / "capture"
    file.write_text("".join(f"2026-11-23 00:00:00 {line}" for line in lines), newline="")
    return file


def test_nmea_sentences_are_converted_to_quantities(written):
    log = open_log(written)
    table = {name: log.source[name].to_numpy(zero_copy_only=False) for name in log.source.column_names}
    assert log.reader == "nmea"
    assert table["t"] == pytest.approx(0.2 * np.arange(300), abs=1e-6), "and goes on after midnight"
    assert np.isnan(table["latitude"]).sum() == (table["quality"] == 0).sum() == 10
    known = np.isfinite(table["latitude"])
    assert table["latitude"][known] == pytest.approx(LATITUDE, abs=2e-9)
    assert table["longitude"][known] == pytest.approx((4.699 + 0.2 * np.arange(300) * EAST)[known], abs=2e-9)
    assert table["speed"] == pytest.approx(3.5 * 1852 / 3600)
    assert table["course"] == pytest.approx(0.0, abs=1e-9)
    assert table["heading"] == pytest.approx(radians(1.5))
    assert log.missing == "the log has no wheel angle"


def test_sentences_of_agopengps_boards_are_read(tmp_path):
    lines = [checked(BOARD.replace("120000.10", f"1200{k:02d}.10")) for k in range(20)]
    (tmp_path / "log").write_text("\r\n".join(lines))
    found = open_log(tmp_path / "log").source.to_pylist()[3]
    assert found["t"] == 3.0
    assert (found["heading"], found["quality"]) == (pytest.approx(0.0, abs=1e-9), 4)
    assert found["roll"] == pytest.approx(radians(-2.5))
    assert found["speed"] == pytest.approx(2.333 * 1852 / 3600)
    assert found["latitude"] == pytest.approx(50.877)


def test_damaged_sentences_are_counted_and_too_many_rejected(tmp_path):
    good = [checked(BOARD.replace("120000.10", f"1200{k:02d}.10")) for k in range(20)]
    spoilt = good[7].replace("N,", "S,", 1)
    (tmp_path / "log").write_text("\n".join([*good[:7], spoilt, *good[8:], good[0][:30]]))
    log = open_log(tmp_path / "log")
    assert len(log.source) == 19
    assert log.notes[0].startswith("2 damaged lines are omitted (first: line 8, ")
    (tmp_path / "log").write_text("\n".join([*good[:4], *[spoilt] * 4]))
    with pytest.raises(FieldLogError, match=r"4 of 8 lines cannot be read \(first: line 5"):
        open_log(tmp_path / "log")


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["$GNHDT,88.5,T"], "none of the 1 sentences has a fix"),
        ([BOARD.replace("120000.10", "996199.10")], "contains no sentences .* 1 sentences with invalid fields"),
        ([BOARD.replace("120000.10", "nan")], "contains no sentences .* 1 sentences with invalid fields"),
    ],
)
def test_malformed_nmea_text_is_rejected_with_the_reason(tmp_path, lines, told):
    (tmp_path / "log").write_text("\n".join(map(checked, lines)))
    with pytest.raises(FieldLogError, match=told):
        open_log(tmp_path / "log")


@pytest.mark.parametrize(("hour", "decrease"), [("115900", "by 89 s"), ("110000", "by 3.63e+03 s")])
def test_sentences_after_a_restart_of_the_recording_are_a_new_segment(tmp_path, hour, decrease):
    """The recording begins again at an earlier time of day, with sentences of two types."""
    times = [f"1200{k:02d}" for k in range(30)] + [f"{hour[:4]}{k:02d}" for k in range(30)]
    lines = [line for each in times for line in (BOARD.replace("120000", each), MOVING.replace("120000", each))]
    (tmp_path / "log").write_text("\n".join(map(checked, lines)))
    log = open_log(tmp_path / "log")
    assert sum("the time decreases" in note for note in log.notes) == 1
    assert f"the time decreases {decrease}; the following rows are a new segment" in log.notes
    t = log.source["t"].to_numpy()
    assert len(t) == 60
    assert sorted(set(np.diff(t).round(6))) == [1.0, 60.0]


def test_infinite_value_in_a_sentence_is_a_missing_value(tmp_path):
    (tmp_path / "log").write_text("\n".join([checked(BOARD), checked("$GPHDT,inf,T"), checked("$GPVTG,90,T,,M,nan,N")]))
    assert "course" in open_log(tmp_path / "log").source.column_names
    assert open_log(tmp_path / "log").source["heading"].to_pylist() == [pytest.approx(pi / 2 - pi / 2, abs=1e-9)]


def test_rmc_sentence_gives_speed_and_course(tmp_path):
    lines = [
        checked(f"$GPRMC,1200{k:02d}.00,{'V' if k == 9 else 'A'},5052.620,N,00441.940,E,7.5,123.5,231126,,,A")
        for k in range(20)
    ]
    (tmp_path / "log").write_text("\r\n".join(lines))
    rows = open_log(tmp_path / "log").source.to_pylist()
    assert (rows[3]["speed"], rows[3]["course"]) == pytest.approx((7.5 * 1852 / 3600, radians(90.0 - 123.5)))
    assert (rows[3]["latitude"], rows[3]["longitude"]) == pytest.approx((50.0 + 52.62 / 60, 4.0 + 41.94 / 60))
    assert all(row["t"] != 9.0 or row["speed"] is None or np.isnan(row["speed"]) for row in rows)


def timed(k):
    """Return the time of day `k` tenths of a second after ten o'clock."""
    return f"10{k // 600:02d}{k % 600 // 10:02d}.{k % 10}0"


def place_of(k):
    """Return the latitude and longitude fields of a machine that moves east, at step `k`."""
    return f"5052.6200000,N,00441.{9400000 + 1000 * k:07d},E"


@pytest.mark.parametrize("kind", ["GGA", "GNS"])
def test_sentences_between_binary_messages_are_read(tmp_path, kind):
    """Binary frames of a receiver may contain any byte, such as $, and need no line end."""
    rng = np.random.default_rng(3)
    parts = []
    for k in range(50):
        frame = b"\xb5\x62\x01\x07" + rng.integers(0, 256, 92, dtype=np.uint8).tobytes() + b"$GP$"
        text = f"$GNGGA,{timed(k)},{place_of(k)},4,12,0.7,35.0,M,0.0,M,1.0,0"
        if kind == "GNS":
            text = f"$GNGNS,{timed(k)},{place_of(k)},RRRR,31,0.5,35.0,0.0,1.0,0,V"
        parts += [frame, checked(text).encode()]
    (tmp_path / "receiver.ubx").write_bytes(b"".join(parts))
    log = open_log(tmp_path / "receiver.ubx")
    assert log.reader == "nmea"
    assert log.notes == (f"from {kind}: quality, latitude, longitude",)
    assert log.missing == "the log has no wheel angle and no speed"
    assert log.source["quality"].to_pylist() == [4] * 50
    assert log.source["longitude"].to_numpy()[-1] == pytest.approx(4 + (41.94 + 49e-4) / 60, abs=1e-9)


@pytest.mark.parametrize("late", [0, 0.3, 3000])
def test_sentences_before_the_first_valid_time_and_fix_are_omitted(tmp_path, late):
    """Before the first fix the clock is arbitrary. Just after the fix the receiver corrects the clock, and a segment
    begins."""
    lines = [f"$GPGGA,0{k}0000.00,,,,,0,00,99.9,,M,,M,," for k in range(9)] + [
        "$GPRMC,,V,,,,,,,,,,N",
        "$GPVTG,,,,,,,,,N",
    ]
    first = 20.0 + late
    lines += [f"$GPGGA,10{int(first // 60):02d}{first % 60:05.2f},{place_of(0)},1,05,2.0,35.0,M,0.0,M,,"]
    lines += [f"$GPGGA,{timed(k)},{place_of(k)},1,09,1.0,35.0,M,0.0,M,," for k in range(200, 300)]
    (tmp_path / "log").write_text("\n".join(map(checked, lines)))
    log = open_log(tmp_path / "log")
    assert len(log.source) == 100 + (late > 0)
    assert log.notes[0].startswith("11 sentences without a valid fix or time")
    assert sum("the time decreases" in note for note in log.notes) == (late > 0)


def test_positions_without_a_fix_quality_are_read(tmp_path):
    lines = [f"$GPGGA,{timed(k)},{place_of(k)},,12,0.7,35.0,M,0.0,M,," for k in range(20)]
    (tmp_path / "log").write_text("\n".join(map(checked, lines)))
    log = open_log(tmp_path / "log")
    assert "quality" not in log.source.column_names
    assert len(log.source["latitude"]) == 20
    assert log.notes == ("from GGA: latitude, longitude",)


def test_positions_without_a_fix_quality_require_the_rmc_status(tmp_path):
    lines = []
    for k in range(20):
        quality, status = ("", "V") if k < 8 else ("1", "A")
        lines += [f"$GPGGA,{timed(k)},{place_of(k)},{quality},3,2.5,35.0,M,0.0,M,,"]
        lines += [f"$GPRMC,{timed(k)},{status},{place_of(k)},7.0,90.0,081009,,,{'AN'[status == 'V']}"]
    (tmp_path / "log").write_text("\n".join(map(checked, lines)))
    assert len(open_log(tmp_path / "log").source) == 12


REASONS = {
    "binary": (bytes([0xB5, 0x62, 1, 7, 92, 0]) * 50, "the file is binary, of an unknown format; record NMEA"),
    "a terminal": (
        b"\x1b[?25l time, lat, lon\n1,52.3,6.7\n" * 9,
        "a recording of a terminal screen; record the output",
    ),
    "UTF-16": ("time,lat,lon\n1,52.3,6.7\n".encode("utf-16"), "the columns are unknown; describe their meaning"),
    "GPX": (b'<?xml version="1.0"?>\n<gpx version="1.1"></gpx>\n', "GPX files contain no wheel angle .* use the file"),
    "KML in one line": (
        b'<kml xmlns="http://www.opengis.net/kml/2.2"><coordinates>6.7,52.3 6.8,52.3</coordinates></kml>',
        "KML files contain no wheel angle and no speed; use the file as a path, with --set path.kind=waypoints",
    ),
    "GeoJSON": (b'{"type": "Point", "coordinates": [6.7, 52.3]}', "GeoJSON files contain no wheel angle and no speed"),
    "a field": (b"$Boundary\nFalse\n3\n1,2,0\n", "AgOpenGPS files contain no wheel angle and no speed"),
    "JSON": (
        b'{"class": "TPV", "lat": 52.3, "lon": 6.7}\n' * 9,
        "no NMEA sentence with a valid checksum and matches no other",
    ),
    "a variometer": (
        b"$LXWP0,N,13.3,21.0,0.03,0.03,0.03,0.03,0.03,0.03,,,*6F\r\n",
        "contains no sentences with a time",
    ),
    "unknown columns": (
        b"time,lat,lon\n1,52.3,6.7\n" * 9,
        "--map map.toml; `agrobot-mj twin --describe` lists the content",
    ),
    "no names": (b"1.06,0.07,0.15\n2.28,0.12,0.29\n" * 9, "the first line has the number 1.06; write the column"),
    "empty names": (b",,,\n1,2,3,4\n", "the first line has no names; write the column names"),
    "no checksum": (b"$GPGGA,222449,3349.0,S,01843.9,E,1,07,2.3,115.4,M,33.3,M,,\r\n" * 9, "have no valid checksum"),
}


@pytest.mark.parametrize("name", REASONS)
def test_unknown_receiver_log_is_rejected_with_a_reason(tmp_path, name):
    content, text = REASONS[name]
    (tmp_path / "log").write_bytes(content)
    with pytest.raises(FieldLogError, match=text):
        open_log(tmp_path / "log").checked_map()


@pytest.mark.parametrize("codec", ["utf-16", "utf-16-be"])
def test_logs_in_utf_16_are_read(tmp_path, codec):
    mark = "" if codec == "utf-16" else "\ufeff"
    (tmp_path / "log").write_bytes((mark + "\r\n".join(drive())).encode(codec))
    log = open_log(tmp_path / "log")
    assert (log.name, log.reader, log.source["quality"].to_pylist()) == ("log", "nmea", [4] * 20)
    rows = "".join(f"{k / 10},{2 * k},südlich\n" for k in range(20))
    (tmp_path / "log.csv").write_bytes(f"{mark}t,Winkel [°],wo\n{rows}".encode(codec))
    log = open_log(tmp_path / "log.csv")
    assert (log.name, log.reader) == ("log.csv", "columns")
    assert log.source["Winkel [°]"].to_pylist() == list(range(0, 40, 2))


def test_rostopic_csv_with_null_bytes_in_a_string_is_read(tmp_path):
    rows = b"".join(b"%d,0\x00\x00\x00,%d.5\n" % (15 * 10**17 + k * 10**8, k) for k in range(20))
    (tmp_path / "bag.txt").write_bytes(b"%time,field.stn_id,field.speed\n" + rows)
    log = open_log(tmp_path / "bag.txt")
    assert log.reader == "columns"
    assert read_columns(log.source, ["field.speed"])["field.speed"] == pytest.approx(np.arange(20) + 0.5)


def test_sentences_in_a_colored_terminal_recording_are_read(tmp_path):
    (tmp_path / "typescript").write_text("\x1b[2J\x08" + "\r\n".join(f"\x1b[32m{line}\x1b[0m" for line in drive()))
    assert open_log(tmp_path / "typescript").source["quality"].to_pylist() == [4] * 20


def test_gnss_sentences_after_many_of_another_instrument_are_read(tmp_path):
    other = checked("$LXWP0,Y,13.0,21.3,0.02,0.02,0.02,0.02,0.02,0.02,,,") + "\r\n"
    (tmp_path / "flight").write_text(other * (1 + HEAD_BYTES // len(other)) + "\r\n".join(drive()))
    log = open_log(tmp_path / "flight")
    assert (log.reader, log.source["quality"].to_pylist()) == ("nmea", [4] * 20)


@pytest.mark.parametrize(("mode", "quality"), [("RRRR", 4), ("FRNN", 4), ("FDAN", 5), ("DANN", 2), ("ANNN", 1)])
def test_fix_quality_of_a_gns_sentence_follows_from_its_best_mode(tmp_path, mode, quality):
    lines = [f"$GNGNS,{timed(k)},{place_of(k)},{mode},31,0.5,35.0,0.0,1.0,0,V" for k in range(9)]
    lines += [f"$GNGNS,{timed(9)},,,,,NNNN,0,99.9,,,,,V"]
    (tmp_path / "log").write_text("\n".join(map(checked, lines)))
    assert open_log(tmp_path / "log").source["quality"].to_pylist() == [quality] * 9 + [0]


def test_sentences_in_time_stamped_lines_and_json_are_read(tmp_path):
    lines = []
    for k in range(20):
        stamp, first = f"2026-05-01T12:00:{k:02d}.250Z", f"$GNRMC,{timed(10 * k)},A,{place_of(k)},2.0,90.0,010526,,,R"
        second = checked(f"$GNGNS,{timed(10 * k)},{place_of(k)},RRRR,31,0.5,35.0,0.0,1.0,0,V")
        lines += [f"{stamp}: {checked(first)}", f'{{"at": "{stamp}", "text": "{second}\\r\\n", "x": 1}}']
    (tmp_path / "app.log").write_text("\r\n".join(lines))
    log = open_log(tmp_path / "app.log")
    assert log.source["t"].to_pylist() == pytest.approx(range(20))
    assert log.source["quality"].to_pylist() == [4] * 20
    assert log.source["speed"].to_numpy() == pytest.approx(2 * 1852 / 3600)


HEADINGS = [
    ("$GNHDT,120.5,T", "$GNHDT,,T"),
    ("$GNTHS,120.5,A", "$GNTHS,120.5,V"),
    ("$GNHPR,TIME,120.5,1.0,0.0,4,20,1.0,0000", "$GNHPR,TIME,120.5,1.0,0.0,5,20,1.0,0000"),
    ("$PTNL,AVR,TIME,+120.5,Yaw,-0.08,Tilt,,,1.2,3,1.4,16", "$PTNL,AVR,TIME,+120.5,Yaw,-0.08,Tilt,,,1.2,2,1.4,16"),
    ("$PASHR,TIME,120.5,T,0.1,0.2,0.0,0.1,0.1,0.2,2,1", "$PASHR,TIME,,T,0.1,0.2,0.0,0.1,0.1,0.2,0,0"),
    ("$PSAT,HPR,TIME,120.5,0.3,,N", "$PSAT,HPR,TIME,120.5,0.3,,"),
    ("$PSTI,036,TIME,010526,120.5,0.1,0.0,R", "$PSTI,036,TIME,010526,120.5,0.1,0.0,F"),
    (
        "$KSXT,20260501TIME,4.7,50.8,35.0,120.5,1.0,90.0,3.6,,3,3,20,20,,,,,,,",
        "$KSXT,20260501TIME,4.7,50.8,35.0,120.5,1.0,90.0,3.6,,3,2,20,20,,,,,,,",
    ),
]
"""Pairs of sentences with a valid heading, and with a doubtful or missing heading."""


@pytest.mark.parametrize(("good", "doubtful"), HEADINGS)
def test_dual_antenna_headings_are_read_only_with_fixed_ambiguities(tmp_path, good, doubtful):
    lines = []
    for k in range(20):
        lines.append(f"$GNGGA,{timed(k)},{place_of(k)},4,12,0.7,35.0,M,0.0,M,1.0,0")
        lines.append((good if k < 15 else doubtful).replace("TIME", timed(k)))
    (tmp_path / "log").write_text("\n".join(map(checked, lines)))
    log = open_log(tmp_path / "log")
    heading = log.source["heading"].to_numpy(zero_copy_only=False)
    assert heading[:15] == pytest.approx(radians(90 - 120.5))
    assert np.isnan(heading[15:]).all()


def test_log_with_only_ksxt_sentences_gives_position_and_speed(tmp_path):
    lines = [HEADINGS[-1][0].replace("TIME", timed(k)) for k in range(20)]
    (tmp_path / "log").write_text("\n".join(map(checked, lines)))
    row = open_log(tmp_path / "log").source.to_pylist()[4]
    assert row == pytest.approx(
        {
            "t": 0.4,
            "latitude": 50.8,
            "longitude": 4.7,
            "quality": 4,
            "speed": 1.0,
            "course": 0.0,
            "heading": radians(-30.5),
        }
    )


def test_sentence_type_with_only_wrong_checksums_is_omitted_and_reported(tmp_path):
    """Some receivers compute the checksum of one sentence wrongly."""
    lines = []
    for k in range(20):
        place = f"5052.62{k:02d},N,00441.94{k:02d},E"
        lines += [f"$GPGGA,1200{k:02d}.00,{place},1,9,0.9,35.0,M,46.0,M,,*00"]
        lines += [checked(f"$GPRMC,1200{k:02d}.00,A,{place},4.5,90.0,040526,,")]
    (tmp_path / "half.nmea").write_text("\n".join(lines))
    found = open_log(tmp_path / "half.nmea")
    assert found.source.num_rows == 20
    assert found.notes[0] == "all 20 GGA sentences are omitted: wrong checksum"
