"""Run of a link whose host switches the sections of an implement, and the field folder of this host."""

import pyarrow.parquet as pq
from typer.testing import CliRunner

from agrobot_mj.cli import app
from agrobot_mj.core.agopengps.messages import SteerData
from agrobot_mj.core.agopengps.traffic import Datagram, Traffic
from agrobot_mj.core.agopengps.wire import encode
from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.core.signals import TICK_S

ORIGIN = Origin(50.877, 4.699)  # Default origin of a link
START = Origin(*to_geodetic(ORIGIN, -40.0, -25.0))  # Start fix of the host
COLOUR = "27,151,160"  # Colour of a strip in Sections.txt


def linked_run(folder, seconds, states):
    """Simulate a run whose host steers straight ahead. `states` returns the bit mask of the sections at a time [s]."""
    traffic = Traffic()
    for turn in range(0, int((seconds + 1) / TICK_S), 2):
        message = SteerData(1.5, int(turn > 0), 0.0, 255, states(turn * TICK_S))  # engage from the second message
        traffic.add(Datagram(turn, turn * TICK_S, "in", "127.0.0.1", encode(message)))
    folder.mkdir()
    pq.write_table(traffic.table(0), folder / "host.parquet")
    sets = ("plant.kind=bicycle", "path.speed_m_s=1.5", "sensors.gnss.sigma_m=0")
    words = [word for key in sets for word in ("--set", key)]
    given = ["link", "straight_line", "--replay", str(folder / "host.parquet"), "--duration", str(seconds), *words]
    ended = CliRunner().invoke(app, [*given, "--no-rrd", "--out", str(folder / "run")])
    assert ended.exit_code == 0, ended.output
    return folder / "run"


def farm(folder, work=""):
    """Write the folder of a field of the host, with the text `work` as its Sections.txt."""
    folder.mkdir()
    head = "2026\r\n$FieldDir\r\nFarm\r\n$Offsets\r\n0,0\r\nConvergence\r\n0\r\nStartFix\r\n"
    (folder / "Field.txt").write_text(f"{head}{START.latitude:.9f},{START.longitude:.9f}\r\n", newline="")
    ring = ((0, 0), (90, 0), (90, 50), (0, 50))
    (folder / "Boundary.txt").write_text("$Boundary\r\nFalse\r\n4\r\n" + "".join(f"{x},{y},0\r\n" for x, y in ring))
    (folder / "Sections.txt").write_text(work, newline="")
    return folder


def strip_rows(points):
    """Return the rows of Sections.txt for a strip with alternating left and right points (n, 2) [m]."""
    lines = [COLOUR, *(f"{x:.3f},{y:.3f},1.57080" for x, y in points)]
    return "\r\n".join([str(len(lines)), *lines]) + "\r\n"
