"""Selection of a log reader by file content, independent of the file name, and user-defined readers."""

import re
import tomllib
from math import cos, sin
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from test_agopenweb import COLUMNS, row
from test_isoxml import HEADER
from test_nmea_text import BOARD, checked

from agrobot_mj import register
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.table_columns import FieldLogError, check_time
from agrobot_mj.extensions.logs.readers import READERS, Head, LogReader, ReadLog, Samples, open_log
from agrobot_mj.extensions.logs.readers.describe import coverage

CSV = b"time_s;steer_angle_deg;speed_km_h;latitude;longitude;fix_quality\n0;1;5;51;4;4\n0.1;1;5;51;4;4\n"
FILES = {
    "agopenweb": "\n".join([COLUMNS, row(0)]).encode(),
    "nmea": b"\n# receiver\n" + checked(BOARD).encode(),
    "can": b"(1.5) can0 0CAC1C13#807D000000000000\n",
    "mcap": b"\x89MCAP0\r\n",
    "isoxml": HEADER.encode(),
    "columns": CSV,
}
"""First bytes of a file for each reader."""


def kind_of(path, data):
    path.write_bytes(data)
    return next((each.kind for each in READERS if each.recognises(Head(path, data[:65536]))), None)


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("name", ["log.csv", "log.parquet", "log"])
def test_reader_is_selected_by_file_content(tmp_path, kind, name):
    assert kind_of(tmp_path / name, FILES[kind]) == kind
    others = [each for each in READERS if each.kind not in (kind, "columns")]
    assert not any(each.recognises(Head(tmp_path / name, FILES[kind])) for each in others)


def test_parquet_file_is_read_as_columns_link_recording_or_run(tmp_path):
    pq.write_table(pa.table({"a": [1.0]}), tmp_path / "x.txt")
    assert open_log(tmp_path / "x.txt").reader == "columns"
    (tmp_path / "run").mkdir()
    pq.write_table(pa.table({"a": [1.0]}), tmp_path / "run" / "signals.parquet")
    assert open_log(tmp_path / "run").source == tmp_path / "run" / "signals.parquet"


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.kind)
def test_no_reader_accepts_a_file_of_unknown_content(reader, tmp_path):
    chance = np.random.default_rng(0)
    junk = (b"", b"\0" * 100, chance.bytes(65536), b"PK\3\4" + bytes(99), b"\n" * 99, "\U0001f69c\n".encode() * 99)
    for data in junk:
        (tmp_path / "x").write_bytes(data)
        assert not reader.recognises(Head(tmp_path / "x", data))
    (tmp_path / "folder").mkdir()
    assert not reader.recognises(Head(tmp_path / "folder", b""))


def test_error_for_an_unknown_log_format_gives_a_remedy(tmp_path):
    (tmp_path / "x").write_bytes(b"north 7 east 8\n")
    with pytest.raises(FieldLogError, match=r"x: .* matches no other known format \(run, .*; export the log as CSV"):
        open_log(tmp_path / "x")
    with pytest.raises(FieldLogError, match="no such file"):
        open_log(tmp_path / "y")


class TwoWords(LogReader):
    """Reader for lines with a time and an angle in gon."""

    kind: Literal["two_words"] = "two_words"

    def recognises(self, head: Head) -> bool:
        return bool(head.lines) and head.lines[0].startswith("gon ")

    def read(self, path: Path) -> ReadLog:
        samples = Samples(path)
        for line in path.read_text().splitlines()[1:]:
            t, angle = map(float, line.split())
            samples.add(t, steer=angle * np.pi / 200, speed=1.0, yaw_rate=0.1, own=3.0)
        return samples.log("lines")


@pytest.fixture
def family():
    before = list(READERS)
    yield
    READERS[:] = before


def test_user_defined_reader_takes_precedence_over_built_in_readers(family, tmp_path, call):
    (tmp_path / "x.csv").write_text("gon ,\n" + "\n".join(f"{k / 10} {k % 7}" for k in range(100)))
    register(TwoWords)
    register(TwoWords)
    assert [each.kind for each in READERS].count("two_words") == 1
    log = open_log(tmp_path / "x.csv")
    assert (log.reader, log.missing) == ("two_words", "")
    assert log.source.column_names == ["t", "speed", "yaw_rate", "steer", "own"]
    assert log.source["steer"].to_numpy()[6] == pytest.approx(6 * np.pi / 200)
    status, out, err = call(
        "replay", str(tmp_path / "x.csv"), "--set", "plant.kind=bicycle", "--out", str(tmp_path / "r")
    )
    assert (status, "on the bicycle plant" in out) == (0, True), err


def test_reader_that_returns_the_wrong_type_is_named_in_the_error(family, tmp_path):
    class Wrong(TwoWords):
        """Reader that returns a number."""

        kind: Literal["wrong"] = "wrong"

        def read(self, path: Path) -> ReadLog:
            return 3

    register(Wrong)
    (tmp_path / "x").write_text("gon \n")
    with pytest.raises(ScenarioError, match=r"the reader \(wrong\): read must return a ReadLog .* got 3"):
        open_log(tmp_path / "x")
    with pytest.raises(ScenarioError, match="kind 'can' already exists"):
        register(type("Can", (TwoWords,), {"__annotations__": {"kind": Literal["can"]}, "kind": "can", "__doc__": "x"}))


def test_each_log_column_keeps_its_own_sample_times(tmp_path):
    samples = Samples(tmp_path / "x")
    for k in range(10):
        samples.add(100 + k, speed=k)
        samples.add(100.5 + k, heading=-k, speed=float("nan"))
        if k == 0:
            samples.add(100.45, heading=7.0)
    table = samples.log("x").source
    assert table["t"].to_numpy() == pytest.approx(sorted([*range(10), *np.arange(10) + 0.5, 0.45]))
    assert table["heading"].drop_null().to_pylist() == [7.0, *(-k for k in range(10))]
    assert table["speed"].null_count == 11


def test_log_with_one_wrong_time_stamp_is_rejected():
    t = np.append(0.05 * np.arange(100), 1e9)
    with pytest.raises(FieldLogError, match="jumps by 1e\\+09 s at row 101; remove the rows with a wrong time"):
        check_time("log", "t", t)


def test_gaps_of_a_signal_do_not_change_its_reported_sample_rate():
    t = np.array([0, 0.1, 0.2, 0.3, 5.3, 5.4, 5.5])
    found = coverage(t, np.where(t == 0.1, np.nan, 1.0))
    assert found == (6, pytest.approx(10), pytest.approx(5.0))
    assert coverage(t, np.full(7, np.nan)) == (0, 0.0, 0.0)


# --- the command --------------------------------------------------------------------------------------------------


def test_describe_command_names_the_log_reader_and_missing_quantities(tmp_path, call):
    (tmp_path / "capture.bin").write_bytes(
        "\n".join(checked(BOARD.replace("120000.10", f"1200{k:02d}.10")) for k in range(20)).encode()
    )
    status, out, err = call("twin", "--describe", str(tmp_path / "capture.bin"))
    assert (status, err) == (0, "")
    assert out.startswith("capture.bin: read as nmea, 19.0 s\nfrom PAOGI: ")
    assert "| latitude  | deg  |     20 |       1 |             1 |" in out
    assert (
        "The log cannot be used for replay, identify or calibrate: the log has no wheel angle.\n\nTemplate of a "
        "map:\n\n[time]"
    ) in out
    assert not list(tmp_path.glob("runs*"))
    status, _, err = call("twin", "--only", "replay", str(tmp_path / "capture.bin"))
    assert (status, err) == (
        2,
        "capture.bin: the log has no wheel angle; `agrobot-mj twin --describe` lists the content of the log\n",
    )


def test_describe_with_a_map_names_missing_quantities(tmp_path, call):
    (tmp_path / "x").write_bytes(CSV.replace(b"time_s", b"ms\x1b[31m"))
    status, out, _ = call("twin", "--describe", str(tmp_path / "x"))
    assert (status, "\x1b" in out, "columns: ms?[31m, steer" in out) == (0, False, True)
    assert "describe their meaning with --map map.toml" in out
    (tmp_path / "x").write_bytes(CSV.replace(b"time_s", b"ms"))
    text = '[time]\ncolumn = "ms"\nunit = "ms"\n[steer]\ncolumn = "steer_angle_deg"\n[speed]\ncolumn = "speed_km_h"\n'
    (tmp_path / "map.toml").write_text(f'{text}[heading]\ncolumn = "latitude"\n')
    status, out, _ = call("twin", "--describe", str(tmp_path / "x"), "--map", str(tmp_path / "map.toml"))
    assert status == 0
    assert out.splitlines()[-1].startswith("The log cannot be used for replay, identify or calibrate (x: ")
    (tmp_path / "map.toml").write_text(f'{text}[heading]\ncolumn = "lattitude"\n')
    status, _, err = call("twin", "--describe", str(tmp_path / "x"), "--map", str(tmp_path / "map.toml"))
    assert (status, "no column 'lattitude' (heading.column); did you mean 'latitude'?" in err) == (2, True)


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (1, "The log has the columns for replay, identify and calibrate: time.column = time_s, "),
        (
            20,
            "The log has the columns for replay, but not for identify and calibrate (x.csv: the rate of [position] "
            "is 1 ",
        ),
    ],
)
def test_describe_command_lists_the_possible_uses_of_a_log(tmp_path, call, rows, told):
    """The log is a bend at 2 m/s at 20 Hz with a position in every n-th row."""
    lines = ["time_s,steer_angle_deg,speed_km_h,latitude,longitude,fix_quality"]
    for k in range(600):
        yaw = 0.2 * (k // rows * rows) / 20
        lines.append(
            f"{k / 20},{6 + 0.01 * (k % 7)},{7.2 + 0.01 * (k % 5)},{51 + 9e-5 * sin(yaw)},{4 - 1.4e-4 * cos(yaw)},4"
        )
    (tmp_path / "x.csv").write_text("\n".join(lines))
    status, out, _ = call("twin", "--describe", str(tmp_path / "x.csv"))
    assert status == 0
    assert out.splitlines()[-1].startswith(told)


@pytest.mark.parametrize(
    ("header", "unit"),
    [("time_ms", "ms"), ("t", "s"), ("Timestamp_NS", "ns"), ("GPS time [ms]", "ms"), ("GNSS time (UTC)", "s")],
)
def test_unknown_columns_are_described_with_rates_and_a_template(call, tmp_path, header, unit):
    scale = {"s": 0.1, "ms": 100, "ns": 100_000_000}[unit]
    rows = "\n".join(f"{k * scale},{400 + k}" for k in range(20))
    (tmp_path / "log.csv").write_text(f"{header},counts\n{rows}\n,500\n")
    status, out, _ = call("twin", "log.csv", "--describe")
    assert status == 0
    assert "log.csv: read as columns, 1.9 s\n" in out
    assert re.search(r"\| counts +\| +\| +20 \| +10 \| +0\.1 \| +400 \| +500 \|", out)
    template = tomllib.loads(out.partition("Template of a map:")[2])
    assert template["time"] == {"column": header, "unit": unit}
    assert set(template) == {"time", "speed", "steer", "yaw_rate", "position"}
    (tmp_path / "log.csv").write_text("a,b\n1,2\n2,3\n")
    assert "Template" not in call("twin", "log.csv", "--describe")[1]
