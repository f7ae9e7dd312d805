"""Damaged recordings of other programs: changed bytes, cut files, and implausible numbers in each format."""

import io
import random
import re
import struct
import tempfile
import warnings
import zipfile
from functools import cache
from pathlib import Path
from unittest.mock import patch

import stranger
from hostile import NUMBERS, VALUES, bent
from judge import call

from agrobot_mj.core.agopengps.position import BoardAttitude, paogi
from agrobot_mj.core.nmea import Solution, gga, vtg
from agrobot_mj.extensions.logs.identify import fit

ROWS = 60
MAP = """
time.column = "t"
steer = { column = "%s", unit = "rad" }
speed.column = "speed"
heading.column = "heading"
"""
RECORDER = b"timestamp,easting,northing,heading,speed,fix,roll,steer_angle,has_guidance\n"
TIMELOG = '<TIM A="" D="4"><PTN A="" B="" D=""/><DLV A="018D" B="" C="DET-1"/></TIM>'
BILLION = '<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]>' + TIMELOG


@cache
def good() -> dict[str, bytes]:
    """Return a valid file for each format, by name."""
    solutions = [Solution(0.2 * k, 51.0, 4.0 + 1e-5 * k, 30.0, 1.5, 0.1) for k in range(ROWS)]
    nmea = b"".join(gga(s) + vtg(s) + paogi(s, BoardAttitude(0.1, 0.0, 0.0, 0.0)) for s in solutions)
    rows = [f"12:00:{k:02d}.000,{k}.5,1.0,90.00,1.00,4,0.50,2.000,1\n".encode() for k in range(ROWS)]
    curvature = [f"({k / 10:.6f}) can0 0CAC1C13#{32128 + k:04X}FFFFFFFFFFFF" for k in range(ROWS)]
    speed = [f"({k / 10:.6f}) can0 18FE4926#DC05FFFFFFFFFFFD" for k in range(ROWS)]
    data = b"".join(struct.pack("<IHiiBBBi", 1000 * k, 17_000, 51 * 10**7, k, 4, 1, 0, 1500) for k in range(ROWS))
    sniffed = [f"10:00:00.000 -> {k}; ID;301 Data;33;{k};147;0;0;21;54;59;" for k in range(ROWS)]
    return {
        "nmea": nmea,
        "agopenweb": RECORDER + b"".join(rows),
        "candump": "\n".join(sorted(curvature + speed)).encode(),
        "sniffed": "\n".join(sniffed).encode(),
        "isoxml": _zip(TIMELOG, data),
        "entities": _zip(BILLION, data),
        "lzma": _zip(TIMELOG, data, zipfile.ZIP_LZMA),
        "bomb": _zip(TIMELOG, bytes(120_000_000)),
        "mcap": _bag(),
    }


def _zip(header: str, data: bytes, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Return task data that contain one time log."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        archive.writestr("TASKDATA/TASKDATA.XML", "<ISO11783_TaskData/>")
        archive.writestr("TASKDATA/TLG00001.XML", header)
        archive.writestr("TASKDATA/TLG00001.BIN", data)
    return out.getvalue()


def _bag() -> bytes:
    """Return an MCAP file with a velocity in each message."""
    from mcap_ros2.writer import Writer

    out = io.BytesIO()
    writer = Writer(out, chunk_size=500)
    schema = writer.register_msgdef("autoware_vehicle_msgs/msg/VelocityReport", "float32 longitudinal_velocity")
    for k in range(ROWS):
        writer.write_message(
            "/speed", schema, {"longitudinal_velocity": 1.5}, log_time=10**8 * k, publish_time=10**8 * k
        )
    writer.finish()
    return out.getvalue()


def logs(chance: random.Random) -> str:
    """Describe or replay a damaged file of any format. The file must be rejected with a message or read in part."""
    content = chance.choice(list(good().values()))
    if chance.random() < 0.3:
        word = chance.choice(re.findall(rb"[\d.]+", content[:5000]) or [b"nothing"])
        content = content.replace(word, chance.choice(NUMBERS).encode(), 3)
    if chance.random() < 0.8:
        content = bent(chance, content, chance.choice([1, 20]))
    Path("log").write_bytes(content)
    if chance.random() < 0.6:
        return call(["twin", "--describe", "log"])
    Path("map.toml").write_text(MAP % chance.choice(["curvature", "steer_demand", "steering_wheel", "speed"]))
    return call("twin log --only replay --map map.toml --set plant.kind=bicycle --out out --to 3".split())


Rows = list[list[str]]
"""Cells of a log by row. The first row contains the column names."""
PARTS = ("calibrate", "identify", "replay", "replay", "valve", "calibrate,replay")
NAMES = ("ms", "pot", "v", "course", "ok", "lat", "lon", "fix", "km/h", "fixed", '"ms"', "unit", "column", "speed")
"""Words of the column map that are exchanged or replaced."""
LOGS = ("log.csv log.csv", "run", "log.csv run", ".", "map.toml", "log.csv map.toml")
"""Arguments in place of the log."""
MORE = ("--from 20", "--to 3", "--share 0.9", "--from 108", "--by valve", "--by steer", "--fit front")
DURATION_S = 110.0  # Duration of the log [s]


@cache
def driven() -> tuple[Rows, str]:
    """Return the log of a machine with unknown sensors, and its column map with a calibrated steering sensor."""
    with tempfile.TemporaryDirectory() as folder, patch.object(stranger, "END_S", DURATION_S):
        h = stranger.write_log(7, Path(folder) / "log.csv")
        rows = [line.split(";") for line in (Path(folder) / "log.csv").read_text().splitlines()]
    steer = f"offset = {h.centre}\nscale = {abs(h.scale)}\npositive = '{'left' if h.scale > 0 else 'right'}'"
    return rows, stranger.MAP.replace('"pot"', f'"pot"\n{steer}')


def _fewer(chance: random.Random, rows: Rows) -> None:
    del rows[chance.choice([0, 1, 2, 3, 5, 9, 100, 400]) :]


def _shuffled(chance: random.Random, rows: Rows) -> None:
    start = chance.randrange(max(len(rows), 1))
    part = rows[start : start + chance.choice([3, 50, len(rows)])]
    chance.shuffle(part)
    rows[start : start + len(part)] = part


def _reversed(chance: random.Random, rows: Rows) -> None:
    rows[1:] = rows[:0:-1]


def _lost_column(chance: random.Random, rows: Rows) -> None:
    at = chance.randrange(8)
    for row in rows[chance.choice([0, 0, 1]) :]:
        del row[at : at + 1]


def _same_column(chance: random.Random, rows: Rows) -> None:
    """Set a column to one value, or to the values of another column."""
    at, other, value = chance.randrange(8), chance.randrange(8), chance.choice([*NUMBERS, "", "true", "12:00:00", "x"])
    fixed = chance.random() < 0.7
    for row in rows[1:]:
        row[at : at + 1] = [value if fixed else row[other]] if len(row) > max(at, other) else []


def _odd_cells(chance: random.Random, rows: Rows) -> None:
    values = chance.choices([*NUMBERS, *VALUES[:30], "1,5", "nan", "", "-1"], k=3)
    for row in chance.choices(rows, k=chance.choice([1, 5, 300])) if rows else ():
        if row:
            row[chance.randrange(len(row))] = chance.choice(values).replace("\n", " ")


def _other_times(chance: random.Random, rows: Rows) -> None:
    """Repeat, decrease or scale times, or convert them to texts."""
    change = chance.choice(["-{}", "{}e-3", "{}e6", "1e300", "{}0", "12:00:{}", "2026-11-30T12:00:{}Z", "nan"])
    for row in rows[chance.choice([1, chance.randrange(1, len(rows))]) if len(rows) > 1 else 1 :]:
        row[:1] = [change.format(row[0])] if row else []


def _other_units(chance: random.Random, rows: Rows) -> None:
    """Change the unit of a column in the second part of the log."""
    at, factor = chance.choice([1, 2, 3, 4, 6]), chance.choice([1 / 3.6, 1e3, -1.0, 1.7e-2, 1e-7])
    for row in rows[len(rows) // chance.choice([2, 3, 10**9]) + 1 :]:
        if len(row) > at and re.fullmatch(r"-?\d+\.?\d*", row[at]):
            row[at] = repr(float(row[at]) * factor)


def _as_text(chance: random.Random, rows: Rows) -> bytes:
    """Return the log as text with an arbitrary separator, encoding and line end."""
    mark, codec = chance.choice(";;,\t| "), chance.choice(["utf-8", "utf-8", "utf-16", "utf-16-le", "utf-32", "cp1252"])
    text = chance.choice(["\n", "\n", "\r\n", "\r", "\n\n"]).join(mark.join(row) for row in rows)
    return (text.replace(".", ",") if mark == ";" and chance.random() < 0.5 else text).encode(codec)


def _odd_map(chance: random.Random, text: str) -> bytes:
    """Return a column map with exchanged words or odd values."""
    for _ in range(chance.choice([1, 1, 2])):
        old, new = chance.sample(NAMES, 2)
        text = text.replace(old, chance.choice([new, new, *VALUES]), chance.choice([1, 1, -1]))
    return text.encode(errors="replace")


DAMAGES = (_fewer, _shuffled, _reversed, _lost_column, _same_column, _odd_cells, _other_times, _other_units)


def twins(chance: random.Random) -> str:
    """Identify the twin of a machine from a damaged log, with a wrong column map, or with odd arguments."""
    kind, (whole, text) = chance.random(), driven()
    rows, told, log, column_map = [list(row) for row in whole], list[str](), "log.csv", "map.toml"
    for damage in chance.sample(DAMAGES, chance.choice([1, 1, 2])) if kind < 0.7 else ():
        damage(chance, rows)
        told.append(damage.__name__)
    content = "\n".join(";".join(row) for row in rows).encode(errors="replace")
    Path("map.toml").write_bytes(_odd_map(chance, text) if 0.7 < kind < 0.8 else text.encode())
    if 0.8 < kind < 0.95:
        content = _as_text(chance, rows) if chance.random() < 0.6 else bent(chance, content, 5)
    elif kind > 0.95:
        Path("run").write_bytes(chance.choice([chance.randbytes(3000), good()["isoxml"]]))
        log, column_map = chance.choice(LOGS), chance.choice(["map.toml", "map.toml", "log.csv", "run", ".", "no.toml"])
    Path("log.csv").write_bytes(content)
    part = chance.choice(["--describe", "", *PARTS])
    words = ["twin", *log.split(), "--map", column_map, "--set", "plant.kind=bicycle", "--out", "out"]
    words += [part] if part == "--describe" else ["--only", part] if part else []
    words += chance.choice(MORE).split() if chance.random() < 0.2 else []
    with patch.multiple(fit, ROUNDS=1, SHORT=1, PAIRS=2), warnings.catch_warnings(action="error"):
        found = call(words)
    return f"{told}: {found}" if found else ""


CLASSES = {"logs": (logs, 0.12, good), "twins": (twins, 0.12, driven)}
