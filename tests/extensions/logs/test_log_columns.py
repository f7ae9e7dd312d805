"""Columns of external logs are read as numbers, or rejected with file, column and a remedy."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from agrobot_mj.core import table_columns as fieldlog
from agrobot_mj.core.table_columns import FieldLogError, check_time, column_names, read_columns

T = 0.05 * np.arange(100)
PER_S = {"s": 1, "ms": 1000, "us": 1_000_000, "ns": 1_000_000_000}


@pytest.fixture
def write(tmp_path):
    def parquet(**columns):
        file = tmp_path / "log.parquet"
        pq.write_table(pa.table(columns), file)
        return file

    return parquet


def test_numeric_columns_of_every_type_are_read_as_floats_and_gaps_as_nan(write):
    file = write(
        t=T,
        whole=pa.array(range(100), pa.int16()),
        small=pa.array(T, pa.float32()),
        gaps=pa.array([None, np.inf, *T[2:]]),
        words=pa.array([1.5, 2.5] * 50).dictionary_encode(),
        clock=pa.array(18 * 10**17 + 30 * np.arange(100), pa.timestamp("ns")),
        **{unit: pa.array((T * per_s).astype("int64"), pa.duration(unit)) for unit, per_s in PER_S.items()},
    )
    found = read_columns(file, column_names(file))
    assert all(values.dtype == np.float64 and values.shape == (100,) for values in found.values())
    assert np.isnan(found["gaps"][:2]).all()
    assert found["words"][1] == 2.5
    assert np.diff(found["clock"]) == pytest.approx(30e-9, rel=1e-9)
    for unit, per_s in PER_S.items():
        assert found[unit] == pytest.approx(np.floor(T * per_s) / per_s, abs=1e-12)


def test_log_with_a_header_only_or_in_another_encoding_is_rejected(tmp_path):
    file = tmp_path / "log.csv"
    for content, message in (
        (b"t,speed", r"log\.csv: the file has column names but no rows; export the file again"),
        ("t,speed\n0,é\n".encode("cp1252"), r"log\.csv: 'speed' contains text that is not in UTF-8; save the file in"),
    ):
        file.write_bytes(content)
        with pytest.raises(FieldLogError, match=message):
            read_columns(file, ["t", "speed"])


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_commas_are_read_with_semicolons_or_tabs(tmp_path, delimiter):
    file = tmp_path / "log.csv"
    file.write_text("\n".join(delimiter.join(row) for row in (("t", "speed"), ("2,05", "-1,5"), ("2,1", ""))))
    found = read_columns(file, ["t", "speed"])
    assert found["t"].tolist() == [2.05, 2.1]
    assert found["speed"][0] == -1.5
    assert np.isnan(found["speed"][1])


@pytest.mark.parametrize("text", ["23:59:22{}", "23:59:22.25{}", "23:59:22,25{}"])
def test_times_of_day_are_read_as_seconds(tmp_path, text):
    (tmp_path / "log.csv").write_text("t;speed\n" + text.format(";1\n") + text.format(";2\n"))
    second = 22.25 if "25" in text else 22.0
    assert read_columns(tmp_path / "log.csv", ["t"])["t"].tolist() == [86340 + second] * 2
    (tmp_path / "log.csv").write_text("t;speed\n" + text.format(";1\n") + "later;2\n")
    with pytest.raises(FieldLogError, match="'t' contains 'later' in row 2, not a time"):
        read_columns(tmp_path / "log.csv", ["t"])


@pytest.mark.parametrize(
    ("values", "told"),
    [
        (["3.5 deg"] * 100, "'bad' contains text .* remove that row or specify another column"),
        (["3.5"] * 100, r"'bad' contains text \('3.5' in row 1\)"),
        (["3.5", *["-1e3"] * 97, "lost", "2"], r"'bad' contains text \('lost' in row 99\)"),
        (["", *[" .5 "] * 98, "inf"], r"'bad' contains text \('inf' in row 100\)"),
        (["3,5"] * 100, "'bad' contains decimal commas"),
        ([[1.0, 2.0]] * 100, "'bad' contains list"),
        ([None] * 100, "'bad' is empty in every row"),
    ],
)
def test_non_numeric_cell_is_reported_with_its_column(write, values, told):
    with pytest.raises(FieldLogError, match=told) as error:
        read_columns(write(t=T, bad=values), ["t", "bad"])
    assert str(error.value).startswith("log.parquet: ")


def test_log_with_column_names_but_no_rows_is_rejected(tmp_path):
    (tmp_path / "log.csv").write_text("t,bad\n")
    with pytest.raises(FieldLogError, match=r"^log.csv: the file has column names but no rows"):
        read_columns(tmp_path / "log.csv", ["t", "bad"])


def test_error_for_a_missing_column_names_the_key_and_a_similar_column(write):
    with pytest.raises(FieldLogError, match=r"no column 'speeed' \(speed.column\); did you mean 'speed'") as error:
        read_columns(write(t=T, speed=T), ["t", "speeed"], {"speeed": "speed.column"})
    assert "(available: t, speed)" in str(error.value)


@pytest.mark.parametrize(
    ("t", "told"),
    [
        (np.zeros(100), "is constant"),
        (T[::-1], "decreases at row 2; sort"),
        (np.concatenate([T[:2], T[1:]]), "does not increase at row 3; sort"),
        (np.floor(T), "each time occurs in 20 rows; export times with more digits"),
        (np.where(T[7] == T, np.nan, T), "is not a number in row 8"),
        (1000 * T, 'indicates milliseconds; set time.unit, e.g. "ms"'),
        (T[:1], "has 1 rows"),
    ],
)
def test_invalid_time_column_is_rejected(t, told):
    with pytest.raises(FieldLogError, match=told):
        check_time("log.csv", "time", t, "time.unit")


def test_log_with_100_million_rows_is_rejected_before_reading(write, monkeypatch):
    file = write(t=T)
    monkeypatch.setattr(fieldlog, "MOST_ROWS", 99)
    monkeypatch.setattr(pq, "read_table", lambda *a, **k: pytest.fail("was read"))
    with pytest.raises(FieldLogError, match="has 100 rows, but the limit is 99"):
        read_columns(file, ["t"])


def test_maximum_number_of_log_rows_is_below_100_million():
    assert fieldlog.MOST_ROWS < 1e8


def test_damaged_parquet_page_is_reported_with_its_column(write):
    file = write(t=T, speed=np.random.default_rng(1).standard_normal(100))
    content = bytearray(file.read_bytes())
    start = pq.read_metadata(file).row_group(0).column(1).dictionary_page_offset or 4
    content[start : start + 40] = bytes(40)
    file.write_bytes(content)
    assert read_columns(file, ["t"])["t"] == pytest.approx(T)
    with pytest.raises(FieldLogError, match=r"'speed' cannot be read.*damaged"):
        read_columns(file, ["speed"])


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "has no header line"),
        (b"PAR1", "is not a valid Parquet file"),
        (b"PK\3\4\xff", "has control characters; export"),
    ],
)
def test_path_that_is_not_a_file_is_rejected(tmp_path, content, told):
    file = tmp_path / "log.parquet"
    file.write_bytes(content)
    with pytest.raises(FieldLogError, match=told):
        column_names(file)


def test_column_with_undecodable_name_is_rejected(tmp_path, write):
    file = write(qqqq=T)
    file.write_bytes(file.read_bytes().replace(b"qqqq", b"q\xf3qq"))
    with pytest.raises(FieldLogError, match="is not a valid Parquet file: 'utf-8' codec"):
        column_names(file)


def test_log_reader_does_not_depend_on_the_file_name(tmp_path, write):
    (tmp_path / "x.parquet").write_text("t,v\n0,1\n")
    assert read_columns(tmp_path / "x.parquet", ["v"])["v"] == [1.0]
    assert column_names(write(t=T).rename(tmp_path / "x.csv")) == ["t"]


def test_folder_or_missing_file_as_log_is_rejected(tmp_path):
    for path, told in ((tmp_path, "is a folder"), (tmp_path / "x.csv", "no such file")):
        with pytest.raises(FieldLogError, match=told):
            column_names(path)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_csv_with_any_common_delimiter_is_read(tmp_path, delimiter):
    file = tmp_path / "log.csv"
    rows = [["t", '"v"', "note"], *([f"{t:.2f}", f"{2 * t:.3f}", "x y"] for t in T)]
    file.write_text("\ufeff" + "\n".join(delimiter.join(row) for row in rows), encoding="utf-8")
    found = read_columns(file, ["t", "v"])
    assert found["v"] == pytest.approx(2 * T, abs=1e-3)


def test_csv_header_in_a_windows_code_page_is_read(tmp_path):
    file = tmp_path / "log.csv"
    file.write_bytes("t;Lenkwinkel [°];Text\n0;1.5;süd\n1;2.5;süd\n".encode("cp1252"))
    assert read_columns(file, ["Lenkwinkel [°]"])["Lenkwinkel [°]"] == pytest.approx([1.5, 2.5])


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "has no header line"),
        (b"t,v\n1,2\n3\n", "cannot be read as CSV"),
        (b"t,v,v\n1,2,3\n", "more than one column 'v'"),
        (b"t,v\n1,two\n", "'v' contains text"),
        (b"\xff\xfet\x00", "control characters; export the file as CSV in UTF-8"),
        (b"t,v\r1,2\r3,4\r", "the lines end with CR only"),
    ],
)
def test_unreadable_csv_is_rejected(tmp_path, content, told):
    file = tmp_path / "log.csv"
    file.write_bytes(content)
    with pytest.raises(FieldLogError, match=told):
        read_columns(file, ["t", "v"])
