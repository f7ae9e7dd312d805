"""Damaged recordings of other programs: changed bytes, cut files, and implausible numbers in each format."""

import io
import random
import re
import struct
import zipfile
from functools import cache
from pathlib import Path

from hostile import NUMBERS, bent
from judge import call

from agrobot_mj.core.agopengps.position import BoardAttitude, paogi
from agrobot_mj.core.nmea import Solution, gga, vtg

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
        "bomb": _zip(TIMELOG, bytes(120_000_000)),
        "mcap": _bag(),
    }


def _zip(header: str, data: bytes) -> bytes:
    """Return task data that contain one time log."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
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
        return call(["replay", "--describe", "log"])
    Path("map.toml").write_text(MAP % chance.choice(["curvature", "steer_demand", "steering_wheel", "speed"]))
    return call(["replay", "log", "--map", "map.toml", "--set", "plant.kind=bicycle", "--out", "out", "--to", "3"])


CLASSES = {"logs": (logs, 0.12, good)}
