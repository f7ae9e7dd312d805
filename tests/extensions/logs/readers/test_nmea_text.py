"""NMEA text: sentences of pynmeagps and of boards, whole and damaged, through midnight and without a fix."""

from math import pi, radians

import numpy as np
import pytest

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.readers import open_log

EAST, LATITUDE = 2.5e-5, 50.877
"""Degrees of longitude a second, some 1.8 m, and latitude."""
BOARD = "$PAOGI,120000.10,5052.6200000,N,00441.9400000,E,4,14,0.7,35.000,1.0,2.333,90.00,-2.50,0.0,5.0"
"""A position sentence of the AgOpenGPS family, without its check."""


def checked(text):
    """A sentence with its check."""
    total = 0
    for character in text[1:]:
        total ^= ord(character)
    return f"{text}*{total:02X}"


@pytest.fixture
def written(tmp_path):
    """A minute at 5 Hz over midnight by pynmeagps, behind the stamps of a logger; the fix is lost for two seconds."""
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


def test_sentences_of_pynmeagps_become_quantities(written):
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
    assert log.missing == "it has no wheel angle"


def test_boards_of_the_agopengps_family_are_read(tmp_path):
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
    assert log.notes[0].startswith("left out 2 damaged lines, first line 8, ")
    (tmp_path / "log").write_text("\n".join([*good[:4], *[spoilt] * 4]))
    with pytest.raises(FieldLogError, match="4 of 8 lines cannot be read, first line 5"):
        open_log(tmp_path / "log")


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["$GNHDT,88.5,T"], "holds no sentences with a time and values"),
        ([BOARD, BOARD.replace("120000", "110000")], "time runs backwards by 3.6e"),
        ([BOARD.replace("120000.10", "996199.10")], "1 of 1 lines cannot be read"),
        ([BOARD.replace("120000.10", "nan")], "1 of 1 lines cannot be read"),
    ],
)
def test_hostile_text_is_refused_in_words(tmp_path, lines, told):
    (tmp_path / "log").write_text("\n".join(map(checked, lines)))
    with pytest.raises(FieldLogError, match=told):
        open_log(tmp_path / "log")


def test_a_reading_of_inf_counts_as_missing(tmp_path):
    (tmp_path / "log").write_text("\n".join([checked(BOARD), checked("$GPHDT,inf,T"), checked("$GPVTG,90,T,,M,nan,N")]))
    assert "course" in open_log(tmp_path / "log").source.column_names
    assert open_log(tmp_path / "log").source["heading"].to_pylist() == [pytest.approx(pi / 2 - pi / 2, abs=1e-9)]


def test_a_recommended_minimum_has_speed_and_course(tmp_path):
    lines = [
        checked(f"$GPRMC,1200{k:02d}.00,{'V' if k == 9 else 'A'},5052.620,N,00441.940,E,7.5,123.5,231126,,,A")
        for k in range(20)
    ]
    (tmp_path / "log").write_text("\r\n".join(lines))
    rows = open_log(tmp_path / "log").source.to_pylist()
    assert (rows[3]["speed"], rows[3]["course"]) == pytest.approx((7.5 * 1852 / 3600, radians(90.0 - 123.5)))
    assert (rows[3]["latitude"], rows[3]["longitude"]) == pytest.approx((50.0 + 52.62 / 60, 4.0 + 41.94 / 60))
    assert all(row["t"] != 9.0 or row["speed"] is None or np.isnan(row["speed"]) for row in rows)
