"""ISO 11783-10 time logs: task data written by the library isoxml, public vectors, and hostile files."""

import shutil
import struct
import zipfile

import numpy as np
import pytest
from public import checkout

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.readers import isoxml as reader
from agrobot_mj.extensions.logs.readers import open_log

HEADER = (
    '<TIM A="" D="4"><PTN A="" B="" C="" D="" F=""/><DLV A="0043" B="" C="DET-1"/><DLV A="018D" B="" C="DET-1"/>'
    '<DLV A="DFFE" B="" C="DET-1" D="44032" E="0" F="15"/><DLV A="DFFE" B="" C="DET-1" D="61444" E="0" F="15"/></TIM>'
)
"""Description of a time log: working width, speed, curvature on the bus, and an unknown bus signal of the engine."""
TASK = '<ISO11783_TaskData VersionMajor="4" VersionMinor="3"/>'
VECTORS = "Dev4Agriculture.ISO11783.ISOXML.Test/testdata"


def record(k, values=(), day=17_000, status=4):
    """Return the record of second `k`, during a drive to the north-east, with process values (number, value)."""
    place = struct.pack("<iiiBH", round(50.877e7) + 600 * k, round(-4.699e7) + 900 * k, 35_000, status, 7)
    body = b"".join(struct.pack("<Bi", *value) for value in values)
    return struct.pack("<IH", 36_000_000 + 1000 * k, day) + place + bytes([len(values)]) + body


RECORDS = [record(k, [(1, 1500)] if k == 0 else [(2, -400), (3, 9)] if k == 30 else []) for k in range(60)]
"""Records of one minute, in which speed and curvature are logged when they change."""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "job").mkdir()
    for name, content in (("TASKDATA.XML", TASK), ("TLG00001.XML", HEADER)):
        (tmp_path / "job" / name).write_text(content)
    (tmp_path / "job" / "TLG00001.BIN").write_bytes(b"".join(RECORDS))
    return tmp_path / "job"


def checked(log):
    """Check the table read from `RECORDS`."""
    column = {name: log.source[name].to_numpy(zero_copy_only=False) for name in log.source.column_names}
    k = np.arange(60)
    assert log.reader == "isoxml"
    assert column["t"] == pytest.approx(k)
    assert column["latitude"] == pytest.approx(50.877 + 6e-5 * k, abs=1e-9)
    assert column["longitude"] == pytest.approx(-4.699 + 9e-5 * k, abs=1e-9)
    assert set(column["quality"]) == {4}
    assert column["speed"] == pytest.approx(1.5)
    assert np.isnan(column["curvature"][:30]).all()
    assert column["curvature"][30:] == pytest.approx(0.1), "counts to the right, without their offset"
    return log


def test_isoxml_folder_file_and_zip_give_the_same_log(folder, tmp_path):
    checked(open_log(folder))
    checked(open_log(folder / "TASKDATA.XML"))
    checked(open_log(folder / "TLG00001.XML"))
    checked(open_log(shutil.make_archive(tmp_path / "zipped", "zip", tmp_path, "job") and tmp_path / "zipped.zip"))


def test_task_data_written_by_the_isoxml_library_is_read(tmp_path):
    """The library isoxml writes the task data and the description of a time log, and reads their bytes."""
    reason = "isoxml is not installed (uv sync, or make install)"
    iso = pytest.importorskip("isoxml.models.base.v4", reason=reason)
    files = pytest.importorskip("isoxml.util.isoxml_io", reason=reason)
    serializers = pytest.importorskip("xsdata.formats.dataclass.serializers", reason=reason)
    value = {"process_data_value": "", "device_element_id_ref": "DET-1"}
    bus = {"process_data_ddi": b"\xdf\xfe", "data_log_pgn_start_bit": 0, "data_log_pgn_stop_bit": 15}
    header = iso.Time(
        start="",
        type=iso.TimeType.Effective,
        positions=[iso.Position(north="", east="", up="", status="", hdop="")],
        data_log_values=[
            iso.DataLogValue(process_data_ddi=b"\x00\x43", **value),
            iso.DataLogValue(process_data_ddi=b"\x01\x8d", **value),
            iso.DataLogValue(data_log_pgn=44032, **bus, **value),
            iso.DataLogValue(data_log_pgn=61444, **bus, **value),
        ],
    )
    log = iso.TimeLog(filename="TLG00001", type=iso.TimeLogType.BinaryTimelogFileType1)
    task = iso.Task(id="TSK-1", status=iso.TaskStatus.Completed, time_logs=[log])
    data = iso.Iso11783TaskData(
        management_software_manufacturer="somebody",
        management_software_version="1",
        data_transfer_origin=iso.Iso11783TaskDataDataTransferOrigin.MICS,
        tasks=[task],
    )
    files.isoxml_to_zip(tmp_path / "task", data, {"TLG00001": b"".join(RECORDS)})
    with zipfile.ZipFile(tmp_path / "task", "a") as archive:
        archive.writestr("TASKDATA/TLG00001.XML", serializers.XmlSerializer().render(header))
    checked(open_log(tmp_path / "task"))


def test_time_logs_are_joined_in_order_and_end_where_they_are_damaged(folder):
    for name, day in (("TLG00002", 16_999), ("TLG00003", 17_001)):
        (folder / f"{name}.xml").write_text(HEADER)
        (folder / f"{name}.bin").write_bytes(b"".join(record(k, day=day) for k in range(20)) + b"\x01" * 9)
    (folder / "TLG00004.XML").write_text(HEADER)
    log = open_log(folder)
    t = log.source["t"].to_numpy()
    assert len(t) == 100
    assert t[[0, 20, 80, 99]] == pytest.approx([0, 86400, 2 * 86400, 2 * 86400 + 19])
    assert log.notes[:3] == (
        f"TLG00002 is damaged after {20 * 22} of {20 * 22 + 9} bytes; only the undamaged part is used",
        f"TLG00003 is damaged after {20 * 22} of {20 * 22 + 9} bytes; only the undamaged part is used",
        "TLG00004.BIN is missing",
    )


def test_position_is_missing_without_a_fix(folder):
    (folder / "TLG00001.BIN").write_bytes(b"".join(record(k, status=0 if k < 5 else 15) for k in range(10)))
    table = open_log(folder).source
    assert table["latitude"].null_count == 5
    assert table["quality"].to_pylist() == [0] * 5 + [None] * 5


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ('<!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;">]>' + HEADER, "declares a document type or entities"),
        (HEADER[:60], "TLG00001.XML: the file is not valid XML"),
        (HEADER.replace("018D", "xyz"), "TLG00001.XML: invalid literal"),
        ("<TIM/>", "contains no time log with positions"),
    ],
)
def test_malformed_task_descriptions_are_rejected_with_the_reason(folder, content, told):
    (folder / "TLG00001.XML").write_text(content)
    with pytest.raises(FieldLogError, match=told):
        open_log(folder)
    (folder / "TLG00001.XML").write_text(content, encoding="utf-16")
    with pytest.raises(FieldLogError, match=r"TLG00001|contains no time log"):
        open_log(folder)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff" * 1000,
        RECORDS[0][:-3],
        RECORDS[0][:21] + b"\xff" + RECORDS[0][22:],
        record(0, [(4, 1)]),
        b"".join(record(k) for k in range(50_401, 50_461)),  # after 24:00
    ],
)
def test_time_log_records_with_impossible_values_are_ignored(folder, data):
    (folder / "TLG00001.BIN").write_bytes(data)
    with pytest.raises(FieldLogError, match="contains no time log with positions"):
        open_log(folder)


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_damaged_zip_of_task_data_is_rejected_with_every_compression(tmp_path, method):
    with zipfile.ZipFile(tmp_path / "z", "w", method) as archive:
        for name, content in {"TLG00001.XML": HEADER, "TLG00001.BIN": b"".join(RECORDS), "TASKDATA.XML": TASK}.items():
            archive.writestr(name, content)
    content = bytearray((tmp_path / "z").read_bytes())
    content[70:90] = bytes(20)
    (tmp_path / "z").write_bytes(content)
    with pytest.raises(FieldLogError, match=r"z: TLG00001.XML: cannot be unpacked: "):
        open_log(tmp_path / "z")


def test_oversized_and_malformed_zips_are_rejected(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "MOST_BIN_BYTES", 10_000_000)

    def zipped(**files):
        with zipfile.ZipFile(tmp_path / "z", "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in files.items():
                archive.writestr(name.replace("_", "."), content)
        return tmp_path / "z"

    with pytest.raises(FieldLogError, match=r"TLG00001.BIN: the file has 11 MB when unpacked, but the limit is 10 MB"):
        open_log(zipped(TASKDATA_XML=TASK, TLG00001_XML=HEADER, TLG00001_BIN=bytes(11_000_000)))
    two = {f"TLG0000{k}_{end}": HEADER if end == "XML" else bytes(6_000_000) for k in (1, 2) for end in ("XML", "BIN")}
    with pytest.raises(FieldLogError, match=r"TLG00002.BIN: the file has 6 MB when unpacked, but the limit is 4 MB"):
        open_log(zipped(TASKDATA_XML=TASK, **two))
    with pytest.raises(FieldLogError, match="the file is binary, of an unknown format"):
        open_log(zipped(readme_txt="hello"))
    data = zipped(TASKDATA_XML=TASK, TLG00001_XML=HEADER, TLG00001_BIN=b"".join(RECORDS)).read_bytes()
    for cut in (data[:300], data[:400] + bytes(50) + data[450:], data[:-30]):
        (tmp_path / "z").write_bytes(cut)
        with pytest.raises(FieldLogError):
            open_log(tmp_path / "z")
    with pytest.raises(FieldLogError, match=r"z: the archive contains TLG00001.XML twice; create the archive again"):
        open_log(zipped(TASKDATA_XML=TASK, TLG00001_XML=HEADER, tlg00001_xml=HEADER))
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "x").write_text(TASK)
    with pytest.raises(FieldLogError, match=r"the folder has neither signals.parquet nor TASKDATA.XML"):
        open_log(tmp_path / "a")


@pytest.mark.parametrize(
    ("name", "positions", "span", "bounds"),
    [
        ("TimeLogs/DuplicatedTimeLog", 8851, 12069.0, (54.57161, 54.58308, 10.19826, 10.21199)),
        ("TimeLogs/TotalsTests/TASKDATA.zip", None, None, None),
        ("TimeLogs/BrokenTimeLogs", 59715, 142083.0, (54.4187, 54.58308, 10.03112, 10.21307)),
        ("ExternalFiles/AFE.zip", 3632, 360.4, (52.35931, 52.3597, 8.029752, 8.034909)),
    ],
)
def test_public_isoxml_files_are_read_completely(name, positions, span, bounds):
    log = open_log(checkout("dev4Agriculture/isoxml-dotnet", "f7a832d9") / VECTORS / name)
    assert [note for note in log.notes if "damaged" in note] == []
    if positions:
        latitude, longitude = (log.source[each].drop_null().to_numpy() for each in ("latitude", "longitude"))
        assert len(latitude) == positions
        assert log.source["t"][-1].as_py() == pytest.approx(span, abs=0.1)
        found = latitude.min(), latitude.max(), longitude.min(), longitude.max()
        assert found == pytest.approx(bounds, abs=1e-5)


def test_course_and_curvature_of_a_public_file_agree():
    """The sign of PGN 44032 is compared with the course and speed of a receiver on the same bus."""
    file = checkout("dev4Agriculture/isoxml-dotnet", "f7a832d9") / VECTORS / "LoadFromStream/Another-single-ACP.zip"
    names = ("t", "course", "curvature", "speed")
    t, course, kappa, speed = (open_log(file).source[n].to_numpy(zero_copy_only=False) for n in names)
    step, turned = np.diff(t), (np.diff(course) + np.pi) % (2 * np.pi) - np.pi
    settled = (
        (step < 1.5) & (np.diff(kappa) == 0) & (np.diff(speed) == 0) & (kappa[1:] * speed[1:] != 0) & (turned != 0)
    )
    assert settled.sum() > 20
    expected = (step * speed[1:] * kappa[1:])[settled]
    assert np.median(turned[settled] / expected) == pytest.approx(1.0, abs=0.02)
